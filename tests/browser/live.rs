//! The page of a watch.

use std::io::{BufRead, BufReader};
use std::process::{Child, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use serde_json::json;

use crate::window::Window;
use crate::{Desk, QUICKSTART};

struct Watch {
    child: Child,
    lines: Receiver<(Instant, String)>,
}

impl Watch {
    fn new(desk: &Desk) -> Self {
        let mut command = desk.salient(&["watch", "--serve", "127.0.0.1:0"]);
        let mut child = command.args(&QUICKSTART[1..]).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        let (sender, lines) = channel();
        let stderr = child.stderr.take().unwrap();
        std::thread::spawn(move || {
            for line in BufReader::new(stderr).lines().map_while(Result::ok) {
                if sender.send((Instant::now(), line)).is_err() {
                    break;
                }
            }
        });
        Self { child, lines }
    }

    /// The next line that holds this, and when it came.
    fn line(&self, text: &str) -> (Instant, String) {
        loop {
            let line = self.lines.recv_timeout(Duration::from_secs(60)).unwrap();
            if line.1.contains(text) {
                return line;
            }
        }
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[test]
fn the_page_follows_edits_and_keeps_camera_and_selection() {
    let desk = Desk::new();
    let watch = Watch::new(&desk);
    let url = watch.line("http://").1.split_whitespace().last().unwrap().to_owned();
    let Some(window) = Window::open(&url) else { return };
    window.wait("return salient.revision === 1");
    watch.line("17 nodes");
    window.js("salient.setState({ view: 'shapes', field: 'eigenfunction', k: 6 })", &[]);
    window.key("#stage", "n");
    window.drag(&[[100.0, 60.0], [160.0, 80.0], [220.0, 90.0]]);
    let keep = "const { view, field, k, picked } = salient.state; return [view, field, k, picked, salient.camera()]";
    let kept = window.js(keep, &[]);
    assert_eq!(kept[3]["index"], json!(0));

    let features = std::fs::read_to_string(desk.path("salient_features.ron")).unwrap();
    let edited = features.replace("radius: 1.7", "radius: 1.5");
    assert_ne!(edited, features);
    std::fs::write(desk.path("salient_features.ron"), &edited).unwrap();
    let (told, _) = watch.line("17 nodes");
    window.wait("return salient.revision === 2");
    eprintln!("the page followed {:.3} s after the terminal", told.elapsed().as_secs_f64());
    assert_eq!(window.js(keep, &[]), kept);
    // Meshes and functions are as they were; only patches were sent.
    assert_eq!(window.number("return salient.loaded"), 4.0);
    assert!(window.text("graph").contains("computed: 7"), "{}", window.text("graph"));

    // Errors are as on the terminal, and the results stand.
    std::fs::write(desk.path("salient_features.ron"), edited.replace("values: 21", "valus: 21")).unwrap();
    window.wait("return !document.getElementById('trouble').hidden");
    let trouble = window.text("trouble");
    assert!(trouble.contains("no port or param `valus`") && trouble.contains("did you mean `values`?"), "{trouble}");
    assert_eq!(window.js(keep, &[]), kept);
    std::fs::write(desk.path("salient_features.ron"), &features).unwrap();
    window.wait("return salient.revision === 3 && document.getElementById('trouble').hidden");
    assert_eq!(window.complaints(), Vec::<String>::new());
}
