//! The report of the quickstart.

use serde_json::json;

use crate::window::Window;
use crate::{Desk, QUICKSTART};

/// Where displayed vertices are: the smallest box on the stage that holds those of a panel, from its corner.
fn projected(window: &Window, panel: usize) -> [f64; 4] {
    let found = window.js(
        "const panel = salient.panels()[arguments[0]], n = panel.skin.values.length, { x, y } = panel.rect;
         let box = [Infinity, Infinity, -Infinity, -Infinity];
         for (let v = 0; v < n; v++) {
           const at = salient.seen(panel, v);
           box = [Math.min(box[0], at.x - x), Math.min(box[1], at.y - y), Math.max(box[2], at.x - x), Math.max(box[3], at.y - y)];
         }
         return box;",
        &[panel.into()],
    );
    std::array::from_fn(|i| found[i].as_f64().unwrap())
}

#[test]
fn the_canvas_shows_the_shapes_and_the_slider_changes_the_function() {
    let Some(window) = Desk::new().report(&QUICKSTART) else { return };
    assert_eq!(window.text("title"), "quickstart.ron");
    window.js("salient.setState({ view: 'shapes', features: false, field: '' })", &[]);
    let plain = window.drawn();
    assert_eq!(plain.len(), 2);
    for (i, panel) in plain.iter().enumerate() {
        // What is drawn has the outline of the vertices as the page itself places them for its lines and clicks.
        let wanted = projected(&window, i);
        let apart = wanted.iter().zip(&panel.bounds).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(apart < 3.0, "{wanted:?}, drawn {:?}", panel.bounds);
        assert!(panel.pixels > 5000.0, "{panel:?}");
    }
    window.js("salient.setState({ field: 'eigenfunction', k: 4 })", &[]);
    for k in [4, 5] {
        assert_eq!(window.js("return salient.state.k", &[]), json!(k));
        assert!(window.text("panels").contains(&format!("k = {k}, λ = ")), "{}", window.text("panels"));
        // The vertices of the greatest and the least value that can be seen are red and blue.
        let ends = window.js(
            "const panel = salient.panels()[0], values = panel.skin.values, marks = [];
             let [low, high] = [null, null];
             values.forEach((value, v) => {
               const at = salient.seen(panel, v), hit = at.front && salient.pick(at.x, at.y);
               if (!hit || hit.vertex !== v) return;
               if (low === null || value < values[low]) low = v;
               if (high === null || value > values[high]) high = v;
             });
             return [low, high].map((v) => { const at = salient.seen(panel, v); return [at.x, at.y, values[v]]; });",
            &[],
        );
        let place = |end: usize| [0, 1].map(|i| ends[end][i].as_f64().unwrap());
        assert!(ends[0][2].as_f64().unwrap() < 0.0 && ends[1][2].as_f64().unwrap() > 0.0, "{ends}");
        let ([r, _, b], [red, _, blue]) = (window.colour(place(0)), window.colour(place(1)));
        assert!(b > r && red > blue, "least {:?}, greatest {:?}", [r, b], [red, blue]);
        if k == 4 {
            window.key("#controls input[name=k]", "\u{e014}");
        }
    }
    let coloured = window.drawn();
    assert!(coloured.iter().zip(&plain).all(|(a, b)| a.sum != b.sum));
    assert_eq!(window.complaints(), Vec::<String>::new());
}

#[test]
fn the_shape_from_its_first_eigenfunctions_is_what_the_node_computes() {
    let Some(window) = Desk::new().report(&["run", "reconstruction.ron"]) else { return };
    // The page sums functions of 16 bits; the meshes beside it are outputs of `reconstruct`.
    let apart = window.js(
        "const panel = (name) => salient.panels().find((it) => it.title === name);
         return [5, 20, 100, 400].map((count) => {
           salient.setState({ morph: true, count });
           const own = panel('mesh').skin.positions, node = panel(`p${count}`).skin.shape.positions;
           return Math.max(...own.map((x, i) => Math.abs(x - node[i])));
         });",
        &[],
    );
    for it in apart.as_array().unwrap() {
        assert!(it.as_f64().unwrap() < 1e-3, "{apart}");
    }
    assert_eq!(window.complaints(), Vec::<String>::new());
}

#[test]
fn a_click_on_a_feature_shows_its_patch_and_descriptor() {
    let Some(window) = Desk::new().report(&QUICKSTART) else { return };
    // The first view is the match that was judged.
    assert_eq!(window.js("return salient.state.view", &[]), json!("pairs oriented"));
    let legend = window.text("legend");
    assert!(legend.contains("right") && legend.contains("objective"), "{legend}");
    // A matched feature in front, with no other one near it.
    let target = window.js(
        "const panel = salient.panels()[0], at = panel.marks.map((mark) => salient.seen(panel, mark.at));
         const alone = (i) => at.every((it, j) => i === j || Math.hypot(it.x - at[i].x, it.y - at[i].y) > 14);
         const i = panel.marks.findIndex((mark, i) => mark.pair && at[i].front && alone(i) && salient.pick(at[i].x, at[i].y)?.mark === mark);
         const pair = panel.marks[i].pair;
         return [at[i].x, at[i].y, pair.points[0], pair.points[1], pair.vertices[0]];",
        &[],
    );
    let [x, y, feature, partner, vertex] = [0, 1, 2, 3, 4].map(|i| target[i].as_f64().unwrap());
    let before = window.drawn();
    window.drag(&[[x, y]]);
    window.wait("return salient.state.picked !== null");
    assert_eq!(window.js("return salient.state.picked.index", &[]), json!(feature as u64));
    let card = window.text("picked");
    for text in [
        format!("Feature {feature}"),
        format!("matched with feature {partner}"),
        format!("{vertex}"),
        "Descriptor".into(),
        "patch".into(),
    ] {
        assert!(card.contains(&text), "{text} is not in {card}");
    }
    // 21 eigenvalues of it and of its partner.
    assert_eq!(window.number("return document.querySelectorAll('#picked rect.bar').length"), 42.0);
    // Both patches are drawn, where they lie on the surface.
    let regions =
        window.js("return salient.panels().map((panel) => panel.skin.region.geometry.attributes.position.count)", &[]);
    assert!(regions[0].as_u64().unwrap() > 3 && regions[1].as_u64().unwrap() > 3, "{regions}");
    let after = window.drawn();
    assert!(before.iter().zip(&after).all(|(a, b)| a.sum != b.sum));
    // By keyboard: nothing selected, then the mirror twin.
    window.key("#stage", "\u{e00c}");
    assert_eq!(window.text("picked"), "");
    window.key("#stage", "m");
    assert_eq!(window.js("return salient.state.set", &[]), json!(1));
    assert_eq!(window.complaints(), Vec::<String>::new());
}

#[test]
fn rotating_one_camera_rotates_the_other_while_they_are_linked() {
    let Some(window) = Desk::new().report(&QUICKSTART) else { return };
    window.js("salient.setState({ view: 'shapes' })", &[]);
    let sums = |window: &Window| window.drawn().iter().map(|panel| panel.sum).collect::<Vec<_>>();
    let first = sums(&window);
    window.drag(&[[100.0, 60.0], [160.0, 80.0], [220.0, 90.0]]);
    let second = sums(&window);
    assert!(first[0] != second[0] && first[1] != second[1], "{first:?} {second:?}");
    let cameras = window.js("return salient.camera()", &[]);
    assert_eq!(cameras[0], cameras[1]);
    window.key("#stage", "c");
    window.drag(&[[100.0, 60.0], [160.0, 80.0], [220.0, 90.0]]);
    let third = sums(&window);
    let cameras = window.js("return salient.camera()", &[]);
    assert_ne!(cameras[0], cameras[1]);
    assert_ne!(second[0], third[0]);
    // By keyboard too, and back to the first camera.
    window.key("#stage", "c");
    window.key("#stage", "\u{e012}");
    assert_ne!(sums(&window), second);
    window.key("#stage", "r");
    assert_eq!(sums(&window), first);
    assert_eq!(window.complaints(), Vec::<String>::new());
}

#[test]
fn a_node_of_the_graph_shows_what_is_known_of_it_and_its_picture() {
    let Some(window) = Desk::new().report(&[&QUICKSTART[..], &["--report-assets", "shared"]].concat()) else { return };
    let click = |address: &str| {
        window.js(
            "const i = salient.scene().sides[0].nodes.findIndex((node) => node.address === arguments[0]);
             document.querySelector(`#graph [data-node=\"${i}\"]`).dispatchEvent(new MouseEvent('click', { bubbles: true }));",
            &[address.into()],
        );
        window.text("details")
    };
    let basis = click("fa/basis");
    for text in ["fa/basis eigensolve", "computed in this run", "pairs", "100", "fa/laplacian", "found", "by inertia"] {
        assert!(basis.contains(text), "{text} is not in {basis}");
    }
    assert_eq!(window.js("return salient.state.field", &[]), json!("eigenfunction"));
    click("fa/energy");
    assert_eq!(window.js("return salient.state.field", &[]), json!("reconstruction energy"));
    click("match");
    assert_eq!(window.js("return salient.state.view", &[]), json!("pairs match"));
    let charts = window.text("charts");
    for title in ["Spectrum", "Matches within a geodesic error", "Time by stage", "iqp_match"] {
        assert!(charts.contains(title), "{title} is not in {charts}");
    }
    // Light and dark differ, and each has readable text: the contrast of WCAG AA.
    for _ in 0..2 {
        let ratio = window.number(
            "const light = (text) => {
               const [r, g, b] = text.match(/[0-9.]+/g).map((x) => x / 255).map((c) => c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4);
               return 0.2126 * r + 0.7152 * g + 0.0722 * b;
             };
             const page = light(getComputedStyle(document.body).backgroundColor);
             const ratios = ['header p', '#details th', '#controls label', 'figcaption', 'button.link'].map((selector) => {
               const text = light(getComputedStyle(document.querySelector(selector)).color);
               return (Math.max(text, page) + 0.05) / (Math.min(text, page) + 0.05);
             });
             return Math.min(...ratios);",
        );
        assert!(ratio > 4.5, "{ratio}");
        window.key("#stage", "t");
    }
    assert_eq!(window.complaints(), Vec::<String>::new());
}
