//! `salient watch` and what becomes of files: editors, exporters, folders, links, storms, other hosts.

use std::fs;
use std::os::unix::fs::symlink;

use super::Desk;
use super::watch::{count, started, values};

fn summed(desk: &Desk, pattern: &str) {
    desk.write(
        "g.ron",
        &format!(
            "(format: 1, over: {{\"shape\": files(\"{pattern}\")}}, nodes: {{\n\
             \"one\": read(path: each(\"shape\")), \"total\": sum(terms: all(\"one\"))}}, show: [\"total\"])"
        ),
    );
}

#[test]
fn files_may_be_saved_as_editors_and_exporters_do() {
    let desk = Desk::new(1);
    desk.write("a.txt", "1\n");
    desk.write("g.ron", "(format: 1, nodes: {\"a\": read(path: \"a.txt\")}, show: [\"a\"])");
    let watch = desk.watch(&["g.ron"]);
    watch.until_value("a", "[1.0]");
    let (path, backup, new) = (desk.path("a.txt"), desk.path("a.txt~"), desk.path("a.txt.tmp"));
    // Written beside and renamed: VS Code's atomic save, and exporters. Twice, since a watch on the file itself
    // hears the first time.
    for value in ["2", "3"] {
        fs::write(&new, format!("{value}\n")).unwrap();
        fs::rename(&new, &path).unwrap();
        watch.until_value("a", &format!("[{value}.0]"));
    }
    // The old one renamed, a new one written, the old one removed: vim.
    for value in ["4", "5"] {
        fs::rename(&path, &backup).unwrap();
        fs::write(desk.path("4913"), "").unwrap();
        fs::remove_file(desk.path("4913")).unwrap();
        fs::write(&path, format!("{value}\n")).unwrap();
        fs::remove_file(&backup).unwrap();
        watch.until_value("a", &format!("[{value}.0]"));
    }
    // The former version renamed to a backup, the new one into its place: Blender.
    fs::write(&new, "6\n").unwrap();
    fs::rename(&path, desk.path("a.txt1")).unwrap();
    fs::rename(&new, &path).unwrap();
    watch.until_value("a", "[6.0]");
    // In place, in pieces.
    let mut file = fs::File::create(&path).unwrap();
    for piece in ["7", "7", "\n8", "\n"] {
        std::io::Write::write_all(&mut file, piece.as_bytes()).unwrap();
        file.sync_all().unwrap();
    }
    drop(file);
    watch.until_value("a", "[77.0, 8.0]");
    // Of equal size and times.
    let time = fs::metadata(&path).unwrap().modified().unwrap();
    fs::write(&path, "78\n8\n").unwrap();
    fs::File::options().write(true).open(&path).unwrap().set_modified(time).unwrap();
    watch.until_value("a", "[78.0, 8.0]");
}

#[test]
fn shapes_may_come_and_go() {
    let desk = Desk::new(1);
    fs::create_dir_all(desk.path("in/x")).unwrap();
    desk.write("in/x/a.txt", "1\n");
    summed(&desk, "in/*/*.txt");
    let watch = desk.watch(&["g.ron"]);
    watch.until_value("total", "[1.0]");
    // In a folder that is listed, and in one that is new.
    desk.write("in/x/b.txt", "2\n");
    let events = watch.until_value("total", "[3.0]");
    assert_eq!(started(&events), ["one[b]", "total"]);
    assert!(events.iter().any(|event| event["added"] == serde_json::json!(["in/x/b.txt"])), "{events:?}");
    fs::create_dir(desk.path("in/y")).unwrap();
    desk.write("in/y/c.txt", "4\n");
    assert_eq!(started(&watch.until_value("total", "[7.0]")), ["one[c]", "total"]);
    fs::create_dir(desk.path("in/z")).unwrap();
    desk.write("in/y/d.txt", "8\n");
    watch.until_value("total", "[15.0]");
    // The folder that was empty when the watch looked is listed too.
    desk.write("in/z/e.txt", "16\n");
    watch.until_value("total", "[31.0]");
    // Renamed within and out.
    fs::rename(desk.path("in/z/e.txt"), desk.path("in/z/f.txt")).unwrap();
    watch.until(|event| event["event"] == "results");
    fs::rename(desk.path("in/z/f.txt"), desk.path("f.txt")).unwrap();
    watch.until_value("total", "[15.0]");
    fs::remove_file(desk.path("in/x/a.txt")).unwrap();
    watch.until_value("total", "[14.0]");
    // What does not match is nobody's business.
    desk.write("in/x/.a.txt.swp", "x");
    desk.write("in/x/notes.md", "x");
    desk.write("in/x/a.txt", "1\n");
    let events = watch.until_value("total", "[15.0]");
    assert_eq!(count(&events, "changed"), 1, "{events:?}");
}

#[test]
fn folders_may_be_removed_and_made_again() {
    let desk = Desk::new(1);
    fs::create_dir_all(desk.path("in/deep")).unwrap();
    desk.write("in/deep/a.txt", "1\n");
    summed(&desk, "in/deep/*.txt");
    let watch = desk.watch(&["g.ron"]);
    watch.until_value("total", "[1.0]");
    for value in ["2", "3"] {
        fs::remove_dir_all(desk.path("in")).unwrap();
        let broken = watch.until_event("broken").pop().unwrap();
        assert_eq!(broken["diagnostics"][0]["code"], "no-files", "{broken}");
        fs::create_dir_all(desk.path("in/deep")).unwrap();
        desk.write("in/deep/a.txt", &format!("{value}\n"));
        watch.until_value("total", &format!("[{value}.0]"));
    }
    // At once, so that the new folder may have the inode of the old one.
    for value in 4..14 {
        fs::remove_dir_all(desk.path("in/deep")).unwrap();
        fs::create_dir_all(desk.path("in/deep")).unwrap();
        desk.write("in/deep/a.txt", &format!("{value}\n"));
        watch.until_value("total", &format!("[{value}.0]"));
        desk.write("in/deep/a.txt", &format!("{value}.5\n"));
        watch.until_value("total", &format!("[{value}.5]"));
    }
}

#[test]
fn the_folder_above_all_may_be_replaced() {
    let desk = Desk::new(1);
    let fill = |value: &str| {
        fs::create_dir_all(desk.path("top/inner")).unwrap();
        desk.write("top/inner/a.txt", value);
        desk.write("top/inner/g.ron", "(format: 1, nodes: {\"a\": read(path: \"a.txt\")}, show: [\"a\"])");
    };
    fill("1\n");
    let graph = desk.path("top/inner/g.ron");
    let watch = desk.watch(&[graph.to_str().unwrap()]);
    watch.until_value("a", "[1.0]");
    // No notice is given of this: what is watched was not touched.
    fs::rename(desk.path("top"), desk.path("old")).unwrap();
    fill("2\n");
    watch.until_value("a", "[2.0]");
    // What was moved away is not watched any more.
    desk.write("old/inner/a.txt", "3\n");
    desk.write("top/inner/a.txt", "4\n");
    watch.until_value("a", "[4.0]");
}

#[test]
fn links_are_followed_and_may_be_turned() {
    let desk = Desk::new(1);
    for (folder, value) in [("v1", "1\n"), ("v2", "2\n")] {
        fs::create_dir(desk.path(folder)).unwrap();
        desk.write(&format!("{folder}/a.txt"), value);
    }
    symlink("v1", desk.path("now")).unwrap();
    symlink("now/a.txt", desk.path("link.txt")).unwrap();
    desk.write("g.ron", "(format: 1, nodes: {\"a\": read(path: \"link.txt\")}, show: [\"a\"])");
    let watch = desk.watch(&["g.ron"]);
    watch.until_value("a", "[1.0]");
    desk.write("v1/a.txt", "5\n");
    watch.until_value("a", "[5.0]");
    symlink("v2", desk.path("next")).unwrap();
    fs::rename(desk.path("next"), desk.path("now")).unwrap();
    watch.until_value("a", "[2.0]");
    desk.write("v2/a.txt", "6\n");
    watch.until_value("a", "[6.0]");
    fs::remove_file(desk.path("link.txt")).unwrap();
    watch.until_event("broken");
    symlink("v1/a.txt", desk.path("link.txt")).unwrap();
    watch.until_value("a", "[5.0]");
}

#[test]
fn files_that_a_node_finds_by_itself_are_watched() {
    let desk = Desk::new(1);
    desk.write("a.txt", "include more/b.txt\nmaybe more/c.txt\n");
    desk.write("g.ron", "(format: 1, nodes: {\"a\": read(path: \"a.txt\")}, show: [\"a\"])");
    let watch = desk.watch(&["g.ron"]);
    // It fails for lack of a file, in a folder that is not there.
    let events = watch.until_idle();
    assert_eq!(count(&events, "failed"), 1);
    fs::create_dir(desk.path("more")).unwrap();
    desk.write("more/b.txt", "1\n");
    watch.until_value("a", "[1.0, 0.0]");
    desk.write("more/b.txt", "2\n");
    watch.until_value("a", "[2.0, 0.0]");
    desk.write("more/c.txt", "");
    watch.until_value("a", "[2.0, 1.0]");
    fs::remove_file(desk.path("more/c.txt")).unwrap();
    assert!(started(&watch.until_value("a", "[2.0, 0.0]")).is_empty());
}

#[test]
fn storms_come_to_nothing_or_to_what_they_changed() {
    let desk = Desk::new(1);
    fs::create_dir(desk.path("in")).unwrap();
    let shape = |i: usize| format!("in/s{i}.txt");
    for i in 0..1000 {
        desk.write(&shape(i), &format!("{i}\n"));
    }
    summed(&desk, "in/*.txt");
    let watch = desk.watch(&["g.ron"]);
    watch.until_value("total", "[499500.0]");
    watch.until_idle();
    // Touched, and written with what they held.
    for i in 0..1000 {
        let file = fs::File::options().write(true).open(desk.path(&shape(i))).unwrap();
        file.set_modified(std::time::SystemTime::now()).unwrap();
        desk.write(&shape(i), &format!("{i}\n"));
        desk.write(&format!("in/other{i}.md"), "x");
    }
    desk.write(&shape(7), "8.25\n");
    let events = watch.until_value("total", "[499501.25]");
    let mut executed = started(&events);
    executed.dedup();
    // A file that is read between being emptied and being filled is an edit of its own.
    assert!(["one[s7]", "total"].iter().all(|name| executed.iter().any(|e| e == name)), "{executed:?}");
    // All changed, by renaming: no file is ever seen half-written.
    for i in 0..1000 {
        desk.write("new", &format!("{}\n", i + 1));
        fs::rename(desk.path("new"), desk.path(&shape(i))).unwrap();
    }
    let events = watch.until_value("total", "[500500.0]");
    let mut executed = started(&events);
    executed.retain(|name| name.starts_with("one"));
    let all = executed.len();
    executed.dedup();
    // One content was there before: what each file holds now is computed once, in however many runs.
    assert!(all == executed.len() && all <= 2, "{all}: {executed:?}");
}

#[test]
fn without_notices_it_looks() {
    let desk = Desk::new(1);
    desk.write("a.txt", "1\n");
    desk.write("g.ron", "(format: 1, nodes: {\"a\": read(path: \"a.txt\")}, show: [\"a\"])");
    let watch = desk.watch(&["g.ron", "--poll", "0.1"]);
    watch.until_value("a", "[1.0]");
    assert_eq!(watch.until_idle()[0]["every"], 0.1);
    desk.write("a.txt", "2\n");
    watch.until_value("a", "[2.0]");
    desk.write("g.ron", "(format: 1, nodes: {\"a\": read(path: \"b.txt\")}, show: [\"a\"])");
    watch.until_event("broken");
    desk.write("b.txt", "3\n");
    watch.until_value("a", "[3.0]");
}

#[test]
fn own_output_and_the_cache_are_no_edits() {
    let desk = Desk::new(1);
    desk.write("a.txt", "1\n");
    // The results land where the files are listed, and so does the cache.
    desk.write("x.json", "");
    fs::create_dir(desk.path("y")).unwrap();
    desk.write("y/n.txt", "");
    desk.write(
        "g.ron",
        "(format: 1, over: {\"shape\": files(\"*.txt\", \"*.json\", \"*/*.txt\")}, nodes: {\n\
         \"one\": read(path: \"a.txt\"), \"listed\": scale(x: \"one\", factor: 1.0)}, show: [\"listed\"])",
    );
    let watch = desk.watch(&["g.ron", "--out", "."]);
    watch.until_value("listed", "[1.0]");
    assert!(desk.path("listed.json").exists() || watch.until_idle().len() == 1);
    desk.write("a.txt", "2\n");
    let mut events = watch.until_value("listed", "[2.0]");
    events.extend(watch.until_idle());
    let own = events.iter().any(|event| event.to_string().contains("listed.json"));
    assert!(!own && count(&events, "run_started") <= 2, "{events:?}");
    // The cache may go, too.
    fs::remove_dir_all(desk.path("cache")).unwrap();
    desk.write("a.txt", "3\n");
    watch.until_value("listed", "[3.0]");
    let written = fs::read_to_string(desk.path("listed.json"));
    watch.until_idle();
    assert!(written.is_ok() && fs::read_to_string(desk.path("listed.json")).unwrap().contains('3'));
}

/// `b` is always written after `a`, so there is no moment at which `b` is ahead. Results that mix an older `a` with a
/// newer `b` were never true.
#[test]
fn results_are_of_one_moment() {
    let desk = Desk::new(1);
    let write = |name: &str, value: u32| {
        desk.write("new", &format!("{value}\n"));
        fs::rename(desk.path("new"), desk.path(name)).unwrap();
    };
    write("a.txt", 0);
    write("b.txt", 0);
    desk.write(
        "g.ron",
        "(format: 1, nodes: {\"a\": read(path: \"a.txt\"), \"b\": read(path: \"b.txt\"), \"s\": slow(x: \"a\", \
         millis: 3), \"t\": slow(x: \"b\", millis: 1)}, show: [\"s\", \"t\"])",
    );
    let watch = desk.watch(&["g.ron", "--poll", "0.05"]);
    for version in 1..400 {
        write("a.txt", version);
        write("b.txt", version);
        // Not to be too fast for any run to be done in between.
        if version % 20 == 0 {
            watch.until_event("results");
        }
    }
    let events = watch.until_value("t", "[399.0]");
    let mut seen = 0;
    for event in events.iter().filter(|event| event["event"] == "results") {
        let read = |node: &str| {
            let value = values(event).into_iter().find(|(name, _)| name == node).unwrap().1;
            value.trim_matches(['[', ']']).parse::<f64>().unwrap()
        };
        assert!((0.0..=1.0).contains(&(read("s") - read("t"))), "{event}");
        seen += 1;
    }
    assert!(seen > 0);
}
