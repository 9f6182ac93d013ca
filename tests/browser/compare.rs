//! Variants side by side.

use serde_json::json;

use crate::Desk;

#[test]
fn variants_are_a_grid_with_one_slider_and_linked_cameras() {
    let arguments = [
        "compare",
        "radius_variants.ron",
        "--variant",
        "paper,barycentric",
        "--set",
        "a.vertices=800",
        "--set",
        "b.vertices=800",
    ];
    let Some(window) = Desk::new().report(&arguments) else { return };
    window.js("salient.setState({ view: 'shapes', features: false, field: 'eigenfunction', k: 3 })", &[]);
    let names = window.js("return salient.panels().map((panel) => panel.title)", &[]);
    assert_eq!(names, json!(["paper: a", "paper: b", "barycentric: a", "barycentric: b"]));
    let before = window.drawn();
    assert!(before.iter().all(|panel| panel.pixels > 1000.0), "{before:?}");
    window.key("#controls input[name=k]", "\u{e014}");
    let after = window.drawn();
    assert!(before.iter().zip(&after).all(|(a, b)| a.sum != b.sum));
    window.drag(&[[100.0, 60.0], [160.0, 80.0], [220.0, 90.0]]);
    assert!(after.iter().zip(&window.drawn()).all(|(a, b)| a.sum != b.sum));
    let differences = window.text("differences");
    for text in ["paper ↔ barycentric", "part first at fa/laplacian", "param `area`", "eigenvalues"] {
        assert!(differences.contains(text), "{text} is not in {differences}");
    }
    assert_eq!(window.complaints(), Vec::<String>::new());
}
