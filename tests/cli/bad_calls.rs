//! Wrong graphs, wrong calls, and caches that cannot be used or were damaged, with the real nodes.

use std::collections::BTreeMap;
use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use crate::real::{PAIR, Real};
use crate::{files, text};

/// A change of the graph that must be refused before anything runs, with these texts among what is said.
const WRONG: [(&str, &str, &[&str]); 11] = [
    ("iqp_match(left", "iqp_mach(left", &["iqp_mach", "did you mean `iqp_match`?"]),
    ("left: \"fa\"", "lfet: \"fa\"", &["lfet", "left"]),
    ("left: \"fa\"", "left: \"fz\"", &["there is no node `fz`", "`fa`, `fb`"]),
    ("left: \"fa\"", "left: \"a\"", &["`left` of `iqp_match` takes `features`, but this is `mesh`"]),
    ("left: \"fa\", ", "", &["the input `left` of `iqp_match` is not wired"]),
    ("right: \"fb\"", "right: \"fb\", candidates: \"six\"", &["`candidates`: expected integer"]),
    ("right: \"fb\"", "right: \"fb\", candidates: 0", &["`candidates` is 0; it must be from 1 to 1000"]),
    ("\"b\":     load", "\"a\":     load", &["duplicate", "`a`"]),
    ("load(path: \"a.off\")", "cut(mesh: \"a\")", &["cycle"]),
    ("a.off", "absent.off", &["the file absent.off does not exist"]),
    ("a.off", "folder.off", &["folder.off is a folder, not a file", "name a file in it"]),
];

#[test]
fn wrong_graphs_are_refused_with_the_place_and_lose_nothing() {
    let real = Real::new();
    real.ok(&["run", PAIR]);
    fs::create_dir(real.path("folder.off")).unwrap();
    let good = real.read(PAIR);
    for (before, now, said) in WRONG {
        real.edit(PAIR, &[(before, now)]);
        for command in [&["run", PAIR][..], &["check", PAIR], &["plan", PAIR], &["get", PAIR, "match"]] {
            let stderr = real.fails(2, command);
            assert!(stderr.contains("match_pair.ron:"), "{now}: no place in: {stderr}");
            for text in said {
                assert!(stderr.contains(text), "{now}: no `{text}` in: {stderr}");
            }
        }
        real.write(PAIR, &good);
    }
    // All at once.
    real.edit(PAIR, &[("left: \"fa\"", "left: \"fz\""), ("b.off", "absent.off"), ("show: [", "show: [\"x\", ")]);
    let stderr = real.fails(2, &["check", PAIR]);
    for text in ["no node `fz`", "absent.off does not exist", "`x`"] {
        assert!(stderr.contains(text), "no `{text}` in: {stderr}");
    }
    real.write(PAIR, &good[..good.len() / 2]);
    real.fails(2, &["run", PAIR]);
    real.write(PAIR, &good);
    assert!(real.executed(&[PAIR]).is_empty());
}

#[test]
fn wrong_overrides_are_refused_with_the_place() {
    let real = Real::new();
    for (set, said) in [
        ("*/patchs.radius=2", "no node matches `*/patchs`"),
        ("*/patches.raduis=2", "did you mean `radius`?"),
        ("*/patches.radius=-1", "it must be from 0.01 to 100"),
        ("*/patches.radius=NaN", "must be a finite number"),
        ("*/patches.radius=1e999", "must be a finite number"),
        ("*/patches.radius=", "radius"),
        ("*/patches.clip=1", "`clip`"),
        ("*/laplacian.area=Baricentric", "did you mean `Barycentric`?"),
        ("a.path=\"a\"", "a file without extension"),
        ("a.path=\"absent.off\"", "absent.off does not exist"),
        ("nonsense", "nonsense"),
    ] {
        let stderr = real.fails(2, &["run", PAIR, "--set", set]);
        assert!(stderr.contains(said), "{set}: no `{said}` in: {stderr}");
        assert!(stderr.contains("--set"), "{set}: no place in: {stderr}");
    }
    let stderr = real.fails(2, &["run", PAIR, "--variant", "paper"]);
    assert!(stderr.contains("paper"), "{stderr}");
    assert!(!real.path("cache").exists(), "nothing was begun");
}

#[test]
fn a_cache_that_cannot_be_used_is_an_error_of_its_own() {
    let real = Real::new();
    real.write("file", "");
    for cache in ["file", "/dev/null", "/proc/salient"] {
        let stderr = real.fails(1, &["run", PAIR, "--cache", cache]);
        let said = format!("error: the cache cannot make {cache}/objects: ");
        assert!(stderr.contains(&said) && stderr.contains("help: name another directory"), "{stderr}");
    }
    fs::create_dir(real.path("foreign")).unwrap();
    real.write("foreign/version", "another cache\n");
    assert!(real.fails(1, &["run", PAIR, "--cache", "foreign"]).contains("another version of salient"));
}

/// A file system of its own in a mount namespace of its own, which ends with the command.
#[test]
fn a_full_cache_directory_is_an_error_and_what_was_kept_is_used() {
    let real = Real::new();
    fs::create_dir(real.path("small")).unwrap();
    let shell = |script: &str| {
        let mut command = Command::new("unshare");
        command.args(["--mount", "sh", "-c", script]).current_dir(real.path("")).env("SALIENT_CACHE", "small");
        command.env("SALIENT", env!("CARGO_BIN_EXE_salient")).output()
    };
    let mount = "mount -t tmpfs -o size=300k tmpfs small";
    if !shell(mount).is_ok_and(|output| output.status.success()) {
        eprintln!("SKIPPED: a full cache directory needs the right to mount a file system");
        return;
    }
    let run = format!("\"$SALIENT\" run {PAIR} --jobs 1");
    // The second run has room again, and finds what the first could keep.
    let script = format!("{mount} && {run}; echo code $? >&2; mount -o remount,size=50m small && {run}");
    let output = shell(&script).unwrap();
    let stderr = text(&output.stderr);
    assert!(output.status.success(), "{stderr}");
    assert!(!stderr.contains("panicked"), "{stderr}");
    let (full, roomy) = stderr.split_once("code 1\n").unwrap_or_else(|| panic!("{stderr}"));
    assert!(full.contains("error: the cache cannot") && full.contains("No space left"), "{full}");
    assert!(full.contains("computed a (load)") && !full.contains("computed match"), "{full}");
    assert!(roomy.contains("computed match") && !roomy.contains("computed a (load)"), "{roomy}");
    assert!(text(&output.stdout).contains("match (iqp_match)"));
}

/// All files of a folder, at any depth, in order.
fn within(folder: &Path) -> Vec<PathBuf> {
    let (folders, mut found): (Vec<_>, Vec<_>) = files(folder).into_iter().partition(|path| path.is_dir());
    found.extend(folders.iter().flat_map(|folder| within(folder)));
    found.sort();
    found
}

#[test]
fn damaged_cache_entries_are_computed_again_never_served() {
    let real = Real::new();
    let get = ["get", PAIR, "match", "--format", "safetensors"];
    let good = real.ok(&get);
    let objects = within(&real.path("cache/objects"));
    assert_eq!(objects.len(), 15);
    for (i, object) in objects.iter().enumerate() {
        let mut bytes = fs::read(object).unwrap();
        match i % 3 {
            0 => bytes = b"garbage".to_vec(),
            1 => bytes.truncate(bytes.len() / 2),
            _ => *bytes.last_mut().unwrap() ^= 1,
        }
        fs::write(object, bytes).unwrap();
    }
    let output = real.call(&get);
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert!(output.stdout == good);
    let stderr = text(&output.stderr);
    assert!(stderr.contains("damaged file in the cache, computing match again: "), "{stderr}");
    for record in within(&real.path("cache/records")) {
        fs::write(record, "garbage").unwrap();
    }
    assert!(real.ok(&get) == good);
    real.ok(&["run", PAIR]);
    assert!(text(&real.ok(&["cache", "verify"])).contains("0 damaged files"));
}

#[test]
fn a_run_killed_at_any_moment_leaves_what_the_next_one_needs() {
    let whole = Real::new();
    whole.ok(&["run", PAIR, "--out", "results"]);
    let expected = results(&whole);
    let real = Real::new();
    let mut finished = 0;
    // Killed after its third, seventh and tenth result: each run begins where the last one was stopped.
    for stop in [3, 4, 3] {
        let mut command = real.command(&["run", PAIR, "--json", "--jobs", "2"]);
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
        let lines = BufReader::new(child.stdout.take().unwrap()).lines().map(Result::unwrap);
        finished += lines.filter(|line| line.contains("\"finished\"")).take(stop).count();
        child.kill().unwrap();
        child.wait().unwrap();
    }
    assert_eq!(finished, 10);
    let executed = real.executed(&[PAIR, "--out", "results"]).len();
    assert!(executed <= 15 - finished, "{executed} of 15 were executed after {finished} were finished");
    assert!(results(&real) == expected);
    assert!(text(&real.ok(&["cache", "verify"])).contains("0 damaged files"));
}

fn results(real: &Real) -> BTreeMap<String, Vec<u8>> {
    let read = |path: PathBuf| (path.file_name().unwrap().to_string_lossy().into_owned(), fs::read(&path).unwrap());
    files(&real.path("results")).into_iter().map(read).collect()
}

#[test]
fn a_closed_pipe_does_not_make_a_failed_run_a_good_one() {
    let real = Real::new();
    let mut command = real.command(&["run", PAIR, "--set", "fa/basis.pairs=5000"]);
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
    drop(child.stdout.take());
    assert_eq!(child.wait().unwrap().code(), Some(1));
}
