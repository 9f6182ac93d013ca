//! What `salient get` draws, read back by others: GLB by the gltf crate, PLY by our own loader, which reads it by another code.

use std::collections::BTreeSet;

use serde_json::Value;

use crate::real::{PAIR, Real, SMALL, lines, numbers};
use crate::text;

/// `get` of a node of the quickstart, small.
fn get<'a>(args: &[&'a str]) -> Vec<&'a str> {
    [&["get", "quickstart.ron"], args, &SMALL].concat()
}

/// A file's mesh as OFF, by `load`.
fn loaded(real: &Real, file: &str) -> (Vec<String>, Vec<String>) {
    real.write("read.ron", format!("(format: 1, nodes: {{\"m\": load(path: \"{file}\")}}, show: [\"m\"])"));
    lines(&text(&real.ok(&["get", "read.ron", "m", "--format", "off"])))
}

#[test]
fn fields_points_and_matches_become_drawings_that_others_read() {
    let real = Real::bare();
    let mesh = lines(&text(&real.ok(&get(&["a", "--format", "off"]))));
    real.ok(&get(&["fa/basis", "-o", "phi.ply", "--index", "3"]));
    assert_eq!(loaded(&real, "phi.ply"), mesh);
    fields(&real, &mesh.0);
    let faces = mesh.1.len();
    real.ok(&get(&["fa/maxima", "-o", "features.ply"]));
    let marked = loaded(&real, "features.ply");
    assert_eq!(marked.0[..mesh.0.len()], mesh.0);
    assert_eq!((marked.0.len(), marked.1.len()), (mesh.0.len() + 6 * 12, faces + 8 * 12));
    matches(&real, &mesh.0);
}

/// Colours and positions of the GLB of the same eigenfunction.
fn fields(real: &Real, vertices: &[String]) {
    real.ok(&get(&["fa/basis", "-o", "phi.glb", "--index", "3"]));
    let (document, buffers) = glb(real, "phi.glb");
    let primitive = document.meshes().next().unwrap().primitives().next().unwrap();
    let reader = primitive.reader(|_| Some(buffers.as_slice()));
    let positions: Vec<[f32; 3]> = reader.read_positions().unwrap().collect();
    let colours: Vec<[f32; 3]> = reader.read_colors(0).unwrap().into_rgb_f32().collect();
    let given: Vec<[f32; 3]> = vertices.iter().map(|l| numbers::<f32>(l).try_into().unwrap()).collect();
    assert_eq!(positions, given);
    let npz = text(&real.ok(&get(&["fa/basis", "--format", "json"])));
    let values: Value = serde_json::from_str(&npz).unwrap();
    assert!(values["values"][3].as_f64().unwrap() > 0.0);
    // The greatest magnitude is at an end of the map: all blue or all red; and there are both.
    let (red, blue) = (colours.iter().filter(|c| c[0] > c[2]).count(), colours.iter().filter(|c| c[2] > c[0]).count());
    assert!(red > 50 && blue > 50, "{red} {blue}");
    real.ok(&get(&["fa/basis", "-o", "grey.glb", "--index", "3", "--colours", "grey"]));
    let (document, buffers) = glb(real, "grey.glb");
    let primitive = document.meshes().next().unwrap().primitives().next().unwrap();
    let grey = primitive.reader(|_| Some(buffers.as_slice())).read_colors(0).unwrap().into_rgb_f32();
    assert!(grey.into_iter().all(|c| c[0] == c[1] && c[1] == c[2]));
}

/// A match: two meshes, and a line for each pair.
fn matches(real: &Real, vertices: &[String]) {
    let found: Value = serde_json::from_slice(&real.ok(&get(&["match", "--format", "json"]))).unwrap();
    let pairs = found["pairs"].as_array().unwrap();
    real.ok(&get(&["match", "-o", "match.glb"]));
    let (document, buffers) = glb(real, "match.glb");
    let primitives: Vec<_> = document.meshes().next().unwrap().primitives().collect();
    assert_eq!(
        primitives.iter().map(gltf::Primitive::mode).collect::<Vec<_>>(),
        [gltf::mesh::Mode::Triangles, gltf::mesh::Mode::Lines]
    );
    let reader = primitives[1].reader(|_| Some(buffers.as_slice()));
    let positions: Vec<[f32; 3]> = reader.read_positions().unwrap().collect();
    let ends: Vec<u32> = reader.read_indices().unwrap().into_u32().collect();
    assert_eq!(ends.len(), 2 * pairs.len());
    for (pair, ends) in pairs.iter().zip(ends.chunks(2)) {
        let left = pair["left_vertex"].as_u64().unwrap() as usize;
        assert_eq!(positions[ends[0] as usize].to_vec(), numbers::<f32>(&vertices[left]));
    }
    // Bare: the same pairs, and nothing else.
    let obj = text(&real.ok(&get(&["match", "--format", "obj", "--bare"])));
    let kinds: BTreeSet<_> = obj.lines().map(|l| l.split(' ').next().unwrap()).collect();
    assert_eq!(kinds, BTreeSet::from(["v", "l"]));
    assert_eq!(obj.lines().filter(|l| l.starts_with("l ")).count(), pairs.len());
}

fn glb(real: &Real, file: &str) -> (gltf::Document, Vec<u8>) {
    let glb = gltf::Gltf::from_slice(&std::fs::read(real.path(file)).unwrap()).unwrap();
    (glb.document, glb.blob.unwrap())
}

#[test]
fn what_cannot_be_drawn_is_refused_before_anything_is_computed() {
    let real = Real::new();
    let graph = r#"(format: 1, nodes: {"a": load(path: "a.off"), "b": load(path: "b.off"),
        "fa": graph(file: "salient_features.ron", mesh: "a"), "fb": graph(file: "salient_features.ron", mesh: "b"),
        "match": iqp_match(left: "fa", right: "fb"), "accuracy": evaluate_match(match: "match", left: "a", right: "b"),
    }, show: ["accuracy"])"#;
    real.write("scored.ron", graph);
    let error = real.fails(2, &["get", "scored.ron", "accuracy", "-o", "x.ply"]);
    assert!(error.contains("has no surface") && error.contains("json, csv, npz, safetensors"), "{error}");
    assert!(!real.path("x.ply").exists());
    let all = real.executed(&[PAIR]);
    assert!(all.iter().any(|node| node == "a"), "the refused call computed something: {all:?}");
    let error = real.fails(2, &["get", PAIR, "match", "-o", "x.json", "--index", "1"]);
    assert!(error.contains("--index"), "{error}");
    let error = real.fails(1, &["get", PAIR, "fa/basis", "-o", "x.ply", "--index", "400"]);
    assert!(error.contains("none of number 400 among the 40 of eigenfunctions 0 to 39"), "{error}");
    let error = real.fails(1, &["get", PAIR, "match", "-o", "x.off"]);
    assert!(error.contains("OFF has no points and lines"), "{error}");
}
