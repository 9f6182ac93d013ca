//! The commands and the code of `docs/notebook.md` do what they say.

use std::process::Command;

use crate::real::{Real, SMALL};
use crate::text;

/// The blocks of a language, one after the other.
fn blocks(document: &str, language: &str) -> String {
    let fence = format!("```{language}\n");
    document.split(&fence).skip(1).filter_map(|rest| rest.split("```").next()).collect()
}

#[test]
fn its_commands_and_its_code_run() {
    let document = include_str!("../../docs/notebook.md");
    let real = Real::bare();
    let commands = blocks(document, "sh");
    assert!(commands.lines().count() > 10);
    for line in commands.lines() {
        let words = line.split('#').next().unwrap().split_whitespace();
        let words: Vec<&str> = words.skip(1).map(|word| word.strip_prefix("graphs/").unwrap_or(word)).collect();
        let small: Vec<&str> =
            SMALL.into_iter().map(|word| word.strip_suffix("=12").map_or(word, |_| "*/maxima.count=25")).collect();
        real.ok(&[words, small].concat());
    }
    let numpy = Command::new("python3").args(["-c", "import numpy"]).output();
    if !numpy.is_ok_and(|output| output.status.success()) {
        eprintln!("skipped: no python3 with numpy");
        return;
    }
    real.write("notebook.py", blocks(document, "python"));
    let output = Command::new("python3").arg("notebook.py").current_dir(real.path("")).output().unwrap();
    assert!(output.status.success(), "{}{}", text(&output.stdout), text(&output.stderr));
    assert_eq!(text(&output.stdout).lines().count(), 3);
}
