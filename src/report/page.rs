//! The page: markup, style, library, script and data in one file, or with the library beside it.

use std::fmt::Write as _;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;

use super::blobs::Blobs;
use super::scene::Scene;

const MARKUP: &str = include_str!("page/index.html");
const STYLE: &str = include_str!("page/style.css");
/// three.js, as `page/vendor/make` bundles it.
pub const LIBRARY: &str = include_str!("page/vendor/three.min.js");
/// Its file name beside pages that share it.
pub const LIBRARY_NAME: &str = "salient-three-r187.js";
/// Our own scripts, in the order in which they build on each other; they share one scope.
const SCRIPTS: [&str; 11] = [
    include_str!("page/data.js"),
    include_str!("page/colour.js"),
    include_str!("page/charts.js"),
    include_str!("page/camera.js"),
    include_str!("page/surface.js"),
    include_str!("page/stage.js"),
    include_str!("page/graph.js"),
    include_str!("page/details.js"),
    include_str!("page/controls.js"),
    include_str!("page/live.js"),
    include_str!("page/app.js"),
];

/// Where the page's library is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Assets {
    /// In the page: one file that needs nothing else.
    Inline,
    /// In a file of its own beside the page, which many pages share.
    Shared,
}

/// What a page may load: its own scripts and nothing from anywhere.
const POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; img-src data: blob:";

/// A page that holds its data.
#[must_use]
pub fn report(scene: &Scene, blobs: &Blobs, assets: Assets) -> String {
    let mut data = format!("<script type=\"application/json\" id=\"scene\">{}</script>\n", json(scene));
    for (name, bytes) in blobs.iter() {
        // Writing to a string cannot fail.
        let _ = writeln!(data, "<script type=\"text/plain\" data-blob=\"{name}\">{}</script>", STANDARD.encode(bytes));
    }
    let (library, policy) = match assets {
        Assets::Inline => (format!("<script>{LIBRARY}</script>"), format!("{POLICY}; script-src 'unsafe-inline'")),
        Assets::Shared => {
            let policy = format!("{POLICY}; script-src 'unsafe-inline' 'self' file:");
            (format!("<script src=\"{LIBRARY_NAME}\"></script>"), policy)
        }
    };
    fill(&scene.title, &policy, &library, &data)
}

/// A page that asks its server for everything.
#[must_use]
pub fn live(title: &str) -> String {
    let policy = format!("{POLICY}; script-src 'unsafe-inline'; connect-src 'self'");
    fill(title, &policy, &format!("<script>{LIBRARY}</script>"), "")
}

/// As JSON that may stand inside a script element.
pub fn json(value: &impl serde::Serialize) -> String {
    serde_json::to_string(value).unwrap_or_else(|_| "null".into()).replace('<', "\\u003c")
}

fn fill(title: &str, policy: &str, library: &str, data: &str) -> String {
    let script = format!("<script>\"use strict\";\n(() => {{\n{}}})();</script>", SCRIPTS.concat());
    let title = title.replace('&', "&amp;").replace('<', "&lt;");
    // One pass, so that no part is looked into for the places of others.
    let mut page = String::with_capacity(MARKUP.len() + STYLE.len() + library.len() + data.len() + script.len());
    let mut rest = MARKUP;
    for (place, text) in [
        ("{{policy}}", policy),
        ("{{title}}", &title),
        ("{{style}}", STYLE),
        ("{{data}}", data),
        ("{{library}}", library),
        ("{{script}}", &script),
    ] {
        let (before, after) = rest.split_once(place).unwrap_or((rest, ""));
        page.push_str(before);
        page.push_str(text);
        rest = after;
    }
    page.push_str(rest);
    page
}
