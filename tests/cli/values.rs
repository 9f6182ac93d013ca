//! The documented keys of what `salient get` writes, and what numpy would read.

use std::collections::BTreeMap;

use serde_json::Value;

use crate::real::{Real, SMALL};
use crate::text;

fn get(real: &Real, node: &str, format: &str) -> Vec<u8> {
    real.ok(&[&["get", "quickstart.ron", node, "--format", format][..], &SMALL].concat())
}

fn json(real: &Real, node: &str) -> Value {
    serde_json::from_slice(&get(real, node, "json")).unwrap()
}

fn keys(value: &Value) -> Vec<&str> {
    value.as_object().unwrap().keys().map(String::as_str).collect()
}

fn floats(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

#[test]
fn the_json_of_every_stage_has_its_documented_keys() {
    let real = Real::bare();
    let basis = json(&real, "fa/basis");
    let values = floats(&basis["values"]);
    assert_eq!((values.len(), values[0]), (40, 0.0));
    assert!(values.is_sorted() && values[1] > 0.0);
    assert_eq!(basis["certificate"]["found"], basis["certificate"]["expected"]);

    // A list at the top.
    let features = json(&real, "fa");
    let features = features.as_array().unwrap();
    assert_eq!(features.len(), 12);
    for feature in features {
        assert_eq!(keys(feature), ["descriptor", "energy", "k", "lambda", "patch", "scale", "vertex", "why"]);
        assert_eq!(keys(&feature["patch"]), ["area", "kind", "vertices"]);
        let k = feature["k"].as_u64().unwrap() as usize;
        assert_eq!(feature["lambda"], values[k]);
        let scale = feature["scale"].as_f64().unwrap();
        assert!((scale * scale * values[k] - 1.0).abs() < 1e-12);
        assert!(feature["vertex"].as_u64().unwrap() < 700);
        match &feature["descriptor"] {
            Value::Null => assert!(feature["why"].as_str().unwrap().len() > 5),
            descriptor => {
                assert_eq!(floats(descriptor).len(), 21);
                assert!(feature["why"].is_null());
            }
        }
    }
    assert!(features.iter().any(|f| f["descriptor"].is_array()));

    let (found, right) = (json(&real, "match"), json(&real, "fb"));
    let pairs = found["pairs"].as_array().unwrap();
    assert!(!pairs.is_empty());
    for pair in pairs {
        assert_eq!(keys(pair), ["descriptor_distance", "left", "left_vertex", "right", "right_vertex"]);
        let of = |features: &[Value], side: &str| features[pair[side].as_u64().unwrap() as usize].clone();
        let (left, right) = (of(features, "left"), of(right.as_array().unwrap(), "right"));
        assert_eq!((&pair["left_vertex"], &pair["right_vertex"]), (&left["vertex"], &right["vertex"]));
    }
    let number = |key: &str| found[key].as_f64().unwrap();
    assert!(number("objective") <= number("bound") && number("gap") >= 0.0);
    assert!((number("gap") - (number("bound") - number("objective"))).abs() < 1e-9);
    // Proved up to rounding.
    assert_eq!(found["proved"], number("gap") < 1e-6 * number("objective"), "{found}");

    let accuracy = json(&real, "accuracy");
    assert_eq!(accuracy["matched"], pairs.len());
    for figures in ["plain", "symmetric"] {
        for key in ["within_5", "within_10"] {
            assert!((0.0..=1.0).contains(&accuracy[figures][key].as_f64().unwrap()), "{accuracy}");
        }
    }
}

/// The entries of a ZIP archive without compression, by their local headers.
fn stored(zip: &[u8]) -> BTreeMap<String, &[u8]> {
    let number = |at: usize, bytes: usize| zip[at..at + bytes].iter().rev().fold(0, |n, b| (n << 8) | usize::from(*b));
    let (mut entries, mut at) = (BTreeMap::new(), 0);
    while zip[at..].starts_with(b"PK\x03\x04") {
        assert_eq!(number(at + 8, 2), 0, "stored, not deflated");
        let (size, name, extra) = (number(at + 18, 4), number(at + 26, 2), number(at + 28, 2));
        let start = at + 30 + name + extra;
        entries.insert(text(&zip[at + 30..at + 30 + name]), &zip[start..start + size]);
        at = start + size;
    }
    entries
}

#[test]
fn eigenvectors_are_written_for_numpy() {
    let real = Real::bare();
    let values = floats(&json(&real, "fa/basis")["values"]);
    let npz = get(&real, "fa/basis", "npz");
    let entries = stored(&npz);
    let array = |name: &str| {
        let file = npyz::NpyFile::new(entries[&format!("{name}.npy")]).unwrap();
        let shape: Vec<u64> = file.shape().to_vec();
        (shape, file.into_vec::<f64>().unwrap())
    };
    assert_eq!(array("values"), (vec![40], values));
    let ((shape, vectors), (_, mass)) = (array("vectors"), array("mass"));
    assert_eq!((shape, mass.len()), (vec![40, 700], 700));
    // V' S V = I, from what another tool reads.
    let vectors: Vec<_> = vectors.chunks(700).collect();
    for a in 0..40 {
        for b in 0..=a {
            let product: f64 = (0..700).map(|i| vectors[a][i] * mass[i] * vectors[b][i]).sum();
            assert!((product - f64::from(u8::from(a == b))).abs() < 1e-10, "{a}, {b}: {product}");
        }
    }
}

#[test]
fn tables_and_surfaces_are_written_for_other_tools() {
    let real = Real::bare();
    let csv = text(&get(&real, "fa", "csv"));
    let header = csv.lines().next().unwrap();
    assert!(header.contains("vertex") && header.ends_with(",d21"), "{header}");
    assert_eq!(csv.lines().count(), 13);
    let obj = text(&get(&real, "a", "obj"));
    assert_eq!(obj.lines().filter(|line| line.starts_with("v ")).count(), 700);
    // A mesh comes back from every format as it went.
    let faces = json(&real, "a")["faces"].clone();
    assert!(faces.is_array());
    for format in ["obj", "off", "ply"] {
        let name = format!("back.{format}");
        real.write(&name, get(&real, "a", format));
        real.write("back.ron", format!("(format: 1, nodes: {{\"m\": load(path: \"{name}\")}}, show: [\"m\"])"));
        assert_eq!(real.json(&["get", "back.ron", "m"])["faces"], faces, "{format}");
    }
    // glTF has single precision.
    real.write("back.glb", get(&real, "a", "glb"));
    real.write("back.ron", "(format: 1, nodes: {\"m\": load(path: \"back.glb\")}, show: [\"m\"])");
    let back = real.json(&["get", "back.ron", "m"]);
    assert_eq!(back["faces"], faces);
    let single = |vertices: &Value| -> Vec<Vec<f64>> {
        let point = |p: &Value| floats(p).into_iter().map(|x| f64::from(x as f32)).collect();
        vertices.as_array().unwrap().iter().map(point).collect()
    };
    let vertices = json(&real, "a")["vertices"].clone();
    assert!(single(&vertices) == back["vertices"].as_array().unwrap().iter().map(floats).collect::<Vec<_>>());

    let safetensors = get(&real, "fa/basis", "safetensors");
    let names = safetensors::SafeTensors::deserialize(&safetensors).unwrap();
    let mut names: Vec<_> = names.names().into_iter().map(ToString::to_string).collect();
    names.sort();
    assert_eq!(names, ["mass", "values", "vectors"]);
}
