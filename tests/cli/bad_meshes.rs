//! Bad meshes through the real command: an error that names the file and the place, and nothing lost.

use serde_json::{Value, json};

use crate::real::{PAIR, Real, creatures, lines, numbers, off};
use crate::text;

/// Runs a bad mesh against the good one: exit code 1, an error of the loader that says `place`, and only the good branch
/// has results.
fn refused(real: &Real, name: &str, content: impl AsRef<[u8]>, place: &str) {
    real.write(name, content);
    let set = format!("a.path={name:?}");
    let output = real.call(&["run", PAIR, "--set", &set]);
    let stderr = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{name}: {stderr}");
    let start = format!("failed a (load) on {name}: ");
    let error = stderr.lines().find(|line| line.starts_with(&start)).unwrap_or_else(|| panic!("{name}: {stderr}"));
    assert!(error.contains(place), "{name}: {error}");
    assert!(stderr.contains("skipped match (iqp_match) because of a"), "{stderr}");
    let stdout = text(&output.stdout);
    assert!(stdout.starts_with("fb (patch_spectrum)\n") && !stdout.contains("match"), "{stdout}");
}

#[test]
fn files_that_hold_no_mesh_are_refused_with_the_place_and_lose_nothing() {
    let real = Real::new();
    real.ok(&["run", PAIR]);
    let garbage: Vec<u8> = (0..500_u32).map(|i| (i * 7919 + 13) as u8).collect();
    let of = |format: &str| real.ok(&["get", PAIR, "b", "--format", format]);
    let half = |bytes: &[u8]| bytes[..bytes.len() / 2].to_vec();

    refused(&real, "half.obj", half(&of("obj")), "OBJ");
    refused(&real, "half.off", half(&of("off")), "the file ends before vertex ");
    refused(&real, "half.ply", half(&of("ply")), "PLY, header: the header counts 13");
    refused(&real, "half.stl", half(&stl(4, 0.0)), "STL, byte 80: the header counts 4 facets");
    refused(&real, "half.glb", half(&glb(0, 0.0)), "glTF, byte 8: the header says");
    refused(&real, "half.gltf", half(document(0).to_string().as_bytes()), "line 1 column ");

    for format in ["obj", "off", "ply", "stl", "glb", "gltf"] {
        let upper = if matches!(format, "glb" | "gltf") { "glTF".to_owned() } else { format.to_uppercase() };
        refused(&real, &format!("garbage.{format}"), &garbage, &upper);
        refused(&real, &format!("nothing.{format}"), "", &upper);
    }

    refused(&real, "nan.obj", "v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n", "OBJ, line 2: vertex 2 ");
    refused(&real, "nan.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 inf 0\n3 0 1 2\n", "OFF, line 5: vertex 2 ");
    refused(&real, "nan.ply", ply("nan 0 0", "3 0 1 2"), "PLY, line 11: vertex 1 of 3");
    refused(&real, "nan.stl", stl(1, f32::NAN), "STL, facet 0 (byte 84)");
    refused(&real, "nan.glb", glb(0, f32::NAN), "glTF, mesh 0, primitive 0: vertex 0");

    refused(&real, "index.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "OBJ, line 4: the face names vertex 9");
    refused(&real, "index.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n", "OFF, line 6: face 0 names vertex 3");
    refused(&real, "index.ply", ply("1 0 0", "3 0 1 7"), "PLY, line 13: face 0 names vertex 7");
    refused(&real, "index.glb", glb(9, 0.0), "glTF, mesh 0, primitive 0: index 2 is 9");

    refused(&real, "empty.off", "OFF\n0 0 0\n", "OFF: the file has no vertices");
    refused(&real, "points.off", "OFF\n1 0 0\n0 0 0\n", "OFF: the file has no faces");

    assert!(real.executed(&[PAIR]).is_empty());
}

/// An STL file whose header counts so many facets, and has them.
fn stl(facets: u32, first: f32) -> Vec<u8> {
    let mut bytes = vec![0; 80];
    bytes.extend(facets.to_le_bytes());
    for _ in 0..facets {
        let floats = [0.0, 0.0, 1.0, first, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        bytes.extend(floats.iter().flat_map(|x: &f32| x.to_le_bytes()));
        bytes.extend([0, 0]);
    }
    bytes
}

fn ply(second: &str, face: &str) -> String {
    format!(
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
         element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n{second}\n0 1 0\n{face}\n"
    )
}

fn document(padding: usize) -> Value {
    json!({
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": 42 + padding}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 6}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]},
            {"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"},
        ],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}], "scene": 0,
    })
}

/// One triangle as GLB, with this last index (if not zero) and first coordinate.
fn glb(last: u16, first: f32) -> Vec<u8> {
    let floats = [first, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let mut binary: Vec<u8> = floats.iter().flat_map(|x| x.to_le_bytes()).collect();
    binary.extend([0, 1, if last == 0 { 2 } else { last }].iter().flat_map(|i: &u16| i.to_le_bytes()));
    binary.extend([0, 0]);
    let mut text = document(2).to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut bytes = b"glTF".to_vec();
    let total = 12 + 8 + text.len() + 8 + binary.len();
    bytes.extend([2, total as u32, text.len() as u32].iter().flat_map(|x: &u32| x.to_le_bytes()));
    bytes.extend(b"JSON");
    bytes.extend(text);
    bytes.extend((binary.len() as u32).to_le_bytes());
    bytes.extend(b"BIN\0");
    bytes.extend(binary);
    bytes
}

#[test]
fn files_that_a_file_names_are_missed_by_name() {
    let real = Real::new();
    let mut lost = document(0);
    lost["buffers"][0]["uri"] = "lost.bin".into();
    real.write("a.gltf", lost.to_string());
    let stderr = real.fails(1, &["run", PAIR, "--set", r#"a.path="a.gltf""#]);
    assert!(stderr.contains("failed a (load) on a.gltf: there is no file lost.bin help: a.gltf names it"), "{stderr}");
}

/// The first mesh with more vertices and faces.
fn with(more: impl FnOnce(&mut Vec<String>, &mut Vec<String>)) -> String {
    let (mut vertices, mut faces) = lines(&creatures()[0]);
    more(&mut vertices, &mut faces);
    off(&vertices, &faces)
}

/// The ends of the first face's first edge, and the point so far along and beside it.
fn beside(vertices: &[String], faces: &[String], away: f64) -> (usize, usize, String) {
    let face = numbers::<usize>(&faces[0]);
    let [a, b] = [face[1], face[2]].map(|v| numbers::<f64>(&vertices[v]));
    let point: Vec<_> = a.iter().zip(b).map(|(x, y)| (0.5 * (x + y) + away).to_string()).collect();
    (face[1], face[2], point.join(" "))
}

/// A run that must work, with a match of at least half the features: the defects of the first mesh that it tells.
fn works(real: &Real, args: &[&str]) -> Vec<String> {
    let results = real.events(&[&[PAIR], args].concat()).pop().unwrap();
    let found = &results["results"][2];
    assert_eq!(found["kind"], "iqp_match");
    let pairs: usize = found["summary"]["matches"].as_str().unwrap().split(' ').next().unwrap().parse().unwrap();
    assert!(pairs >= 6, "{found}");
    let texts = found["defects"].as_array().unwrap().iter().filter(|d| d["node"] == "a");
    texts.map(|d| d["text"].as_str().unwrap().to_owned()).collect()
}

#[test]
fn faces_without_area_are_refused_until_they_are_dropped() {
    let real = Real::new();
    real.ok(&["run", PAIR]);
    let slivers = with(|vertices, faces| {
        let (a, b, middle) = beside(vertices, faces, 0.0);
        // Exactly on the line, whatever the rounding: the same point twice.
        vertices.push(middle);
        faces.push(format!("3 {a} {b} {b}"));
        faces.push(format!("3 {a} {b} {}", vertices.len() - 1));
    });
    real.write("a.off", slivers);
    let (_, faces) = lines(&creatures()[0]);
    let stderr = real.fails(1, &["run", PAIR]);
    let place = format!("failed fa/laplacian (laplacian): the mesh has no Laplacian: face {} ", faces.len());
    assert!(stderr.contains(&place), "{stderr}");
    assert!(stderr.contains("`drop_degenerate: true, drop_unreferenced: true`"), "{stderr}");
    let stderr = real.fails(1, &["run", PAIR, "--set", "a.drop_degenerate=true"]);
    assert!(stderr.contains("vertex 700 belongs to no face help: add `drop_unreferenced: true`"), "{stderr}");
    // What the repairs leave is the mesh as it was, so all but loading is known already.
    let repairs = ["--set", "a.drop_degenerate=true", "--set", "a.drop_unreferenced=true"];
    let defects = works(&real, &repairs);
    assert_eq!(defects.len(), 2, "{defects:?}");
    assert!(defects.iter().all(|d| d.starts_with("repaired ")), "{defects:?}");
}

#[test]
fn non_manifold_meshes_work_and_say_so() {
    let real = Real::new();
    let fin = with(|vertices, faces| {
        let (a, b, point) = beside(vertices, faces, 0.1);
        vertices.push(point);
        faces.push(format!("3 {a} {b} {}", vertices.len() - 1));
    });
    real.write("a.off", fin);
    assert!(works(&real, &[])[0].starts_with("non-manifold edge × 1"));
    let stderr = real.fails(1, &["run", PAIR, "--set", "*/laplacian.intrinsic_delaunay=true"]);
    assert!(stderr.contains("has 3 faces"), "{stderr}");
    assert!(stderr.contains("help: `intrinsic_delaunay: false` works"), "{stderr}");
}

#[test]
fn several_components_work_and_the_largest_can_be_kept() {
    let real = Real::new();
    real.ok(&["run", PAIR]);
    // A tetrahedron of its own, numbered after the creature.
    let two = with(|vertices, faces| {
        let n = vertices.len();
        vertices.extend(["5 0 0", "5.1 0 0", "5 0.1 0", "5 0 0.1"].map(str::to_owned));
        let tetrahedron = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]];
        faces.extend(tetrahedron.map(|[a, b, c]| format!("3 {} {} {}", n + a, n + b, n + c)));
    });
    real.write("a.off", two);
    assert_eq!(works(&real, &[]), ["further component × 1, first at 700"]);
    let values = real.json(&["get", PAIR, "fa/basis"])["values"].clone();
    assert_eq!((&values[0], &values[1]), (&json!(0.0), &json!(0.0)), "one zero for each component");
    assert!(values[2].as_f64().unwrap() > 0.0);
    let repair = ["--set", "a.largest_component=true"];
    assert_eq!(works(&real, &repair), ["repaired further component × 1, first at 700"]);
    let values = real.json(&[&["get", PAIR, "fa/basis"][..], &repair].concat())["values"].clone();
    assert!(values[0] == 0.0 && values[1].as_f64().unwrap() > 0.0);
}

#[test]
fn open_boundaries_work_and_are_told() {
    let real = Real::new();
    let open = with(|_, faces| {
        let first = numbers::<usize>(&faces[0])[1];
        faces.retain(|face| !numbers::<usize>(face)[1..].contains(&first));
    });
    real.write("a.off", open);
    let stderr = real.fails(1, &["run", PAIR]);
    assert!(stderr.contains("belongs to no face help: add `drop_unreferenced: true`"), "{stderr}");
    let defects = works(&real, &["--set", "a.drop_unreferenced=true"]);
    assert!(defects.iter().any(|d| d.starts_with("boundary edge × ")), "{defects:?}");
}

#[test]
fn more_eigenpairs_than_vertices_are_refused_by_number() {
    let real = Real::new();
    let stderr = real.fails(1, &["run", PAIR, "--set", "fa/basis.pairs=701"]);
    assert!(
        stderr.contains("failed fa/basis (eigensolve): 701 eigenpairs were asked for, but 700 vertices"),
        "{stderr}"
    );
    assert!(stderr.contains("help: ask for `pairs: 700` or fewer"), "{stderr}");
    assert!(!real.executed(&[PAIR]).iter().any(|node| node.starts_with("fb/")), "the other branch was kept");
}
