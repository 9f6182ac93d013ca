//! `--report`: refused before anything is computed, whole or not at all, and of use without any surface.

use serde_json::Value;

use crate::real::{Real, SMALL};
use crate::{Desk, text};

/// The scene that a page holds.
fn scene(page: &str) -> Value {
    let (_, rest) = page.split_once("id=\"scene\">").unwrap();
    serde_json::from_str(rest.split_once("</script>").unwrap().0).unwrap()
}

#[test]
fn a_place_that_cannot_be_written_is_refused_before_anything_is_computed() {
    let desk = Desk::new(1);
    std::fs::create_dir(desk.path("folder")).unwrap();
    for (place, code, what) in [("a.txt/r.html", 1, "cannot write a.txt/r.html"), ("folder", 2, "folder is a folder")] {
        let output = desk.call(&["run", "g.ron", "--report", place]);
        assert_eq!(output.status.code(), Some(code));
        let said = text(&output.stderr);
        assert!(said.contains(what) && !said.contains("computed"), "{said}");
    }
    assert_eq!(desk.executed().len(), 4);
}

#[test]
fn a_graph_without_surfaces_and_with_failures_has_a_report() {
    let desk = Desk::new(1);
    desk.write("x.txt", "</script><b>\n");
    desk.write("bad.ron", "(format: 1, nodes: {\"x\": read(path: \"x.txt\"), \"y\": sum(terms: \"x\"), \"a\": read(path: \"a.txt\")}, show: [\"y\", \"a\"])");
    let output = desk.call(&["run", "bad.ron", "--report", "new/r.html"]);
    assert_eq!(output.status.code(), Some(1));
    let page = std::fs::read_to_string(desk.path("new/r.html")).unwrap();
    let scene = scene(&page);
    assert_eq!(scene["surfaces"], serde_json::json!([]));
    let nodes = scene["sides"][0]["nodes"].as_array().unwrap();
    let of = |address: &str| nodes.iter().find(|node| node["address"] == address).unwrap();
    assert_eq!(
        (&of("x")["outcome"], &of("y")["outcome"], &of("a")["outcome"]),
        (&"failed".into(), &"skipped".into(), &"computed".into())
    );
    assert!(of("x")["message"].as_str().unwrap().contains("</script><b>"), "{}", of("x"));
    assert_eq!(of("a")["summary"][0], serde_json::json!(["count", "3"]));
    // What came from outside cannot end the element that it stands in.
    assert!(!page.split_once("id=\"scene\">").unwrap().1.split_once("</script>").unwrap().0.contains('<'));
    // Nothing is left beside it, and nothing of the page comes from elsewhere.
    assert_eq!(crate::files(&desk.path("new")).len(), 1);
    assert!(page.contains("default-src 'none'") && !page.contains("src=\"http"));
}

#[test]
fn pages_that_share_the_library_are_small() {
    let desk = Desk::new(1);
    desk.ok(&["run", "g.ron", "--report", "whole.html"]);
    desk.ok(&["run", "g.ron", "--report", "r/one.html", "--report-assets", "shared"]);
    desk.ok(&["run", "g.ron", "--report", "r/two.html", "--report-assets", "shared"]);
    let mut names: Vec<_> =
        crate::files(&desk.path("r")).iter().map(|f| f.file_name().unwrap().to_string_lossy().into_owned()).collect();
    names.sort();
    assert_eq!(names.len(), 3, "{names:?}");
    let [whole, one, library] = ["whole.html", "r/one.html", &format!("r/{}", names[1])]
        .map(|name| std::fs::read_to_string(desk.path(name)).unwrap());
    assert!(one.contains(&format!("<script src=\"{}\">", names[1])), "{names:?}");
    assert!(
        library.len() > 300_000 && one.len() + 300_000 < whole.len(),
        "{} {} {}",
        library.len(),
        one.len(),
        whole.len()
    );
}

#[test]
fn functions_in_a_page_are_those_of_the_artefact_and_large_surfaces_are_simplified() {
    use base64::Engine as _;
    let real = Real::bare();
    let arguments = ["run", "quickstart.ron", "--report", "r.html", "--report-detail"];
    for detail in ["1000000", "300"] {
        real.ok(&[&arguments[..], &[detail], &SMALL].concat());
        let page = std::fs::read_to_string(real.path("r.html")).unwrap();
        let scene = scene(&page);
        let bytes = |name: &Value| {
            let (_, rest) = page.split_once(&format!("data-blob=\"{}\">", name.as_str().unwrap())).unwrap();
            base64::engine::general_purpose::STANDARD.decode(rest.split_once('<').unwrap().0).unwrap()
        };
        let side = &scene["sides"][0];
        let field = side["fields"].as_array().unwrap().iter().find(|f| f["name"] == "eigenfunction").unwrap();
        let surface = &scene["surfaces"][field["surface"].as_u64().unwrap() as usize];
        let shown = surface["vertices"].as_u64().unwrap() as usize;
        let source: Vec<usize> = if surface["source"].is_null() {
            (0..shown).collect()
        } else {
            bytes(&surface["source"]).chunks(4).map(|b| u32::from_le_bytes(b.try_into().unwrap()) as usize).collect()
        };
        let whole = surface["mesh"][0].as_u64().unwrap() as usize;
        if detail == "300" {
            assert!(shown < whole && shown <= 330, "{shown} of {whole}");
            assert!(scene["notes"][0].as_str().unwrap().contains("simplified"), "{}", scene["notes"]);
        } else {
            assert_eq!((shown, &scene["notes"]), (whole, &serde_json::json!([])));
        }
        // The artefact by another way: the arrays of `get --format npz`.
        let node = side["nodes"][field["node"].as_u64().unwrap() as usize]["address"].as_str().unwrap();
        let npz = real.ok(&[&["get", "quickstart.ron", node, "--format", "safetensors"][..], &SMALL].concat());
        let tensors = safetensors::SafeTensors::deserialize(&npz).unwrap();
        let vectors: Vec<f64> = tensors
            .tensor("vectors")
            .unwrap()
            .data()
            .chunks(8)
            .map(|b| f64::from_le_bytes(b.try_into().unwrap()))
            .collect();
        let values: Vec<u16> =
            bytes(&field["values"]).chunks(2).map(|b| u16::from_le_bytes(b.try_into().unwrap())).collect();
        for (k, range) in field["ranges"].as_array().unwrap().iter().enumerate() {
            let [low, high] = [0, 1].map(|i| range[i].as_f64().unwrap());
            for (i, vertex) in source.iter().enumerate() {
                let value = low + (high - low) * f64::from(values[k * shown + i]) / 65535.0;
                let wanted = vectors[k * whole + vertex];
                assert!((value - wanted).abs() <= (high - low) / 65535.0, "k {k}, vertex {vertex}: {value}, {wanted}");
            }
        }
    }
}
