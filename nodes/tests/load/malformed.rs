//! What is refused, with its place.

use serde_json::{Value, json};

use super::{files, load};

/// Expects an error that holds all of these words.
fn refused(name: &str, bytes: &[u8], words: &[&str]) {
    let error = match load(name, bytes) {
        Ok(mesh) => panic!("{name} was loaded, {} faces; expected {words:?}", mesh.faces.len()),
        Err(error) => error.message,
    };
    for word in words {
        assert!(error.contains(word), "{name}: `{error}` lacks `{word}`");
    }
}

const THREE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";

#[test]
fn obj() {
    let with = |more: &str| format!("{THREE}{more}").into_bytes();
    refused("a.obj", b"", &["OBJ", "no vertices"]);
    refused("a.obj", b"\x00\xffgarbage\n\n", &["OBJ", "no vertices"]);
    refused("a.obj", THREE.as_bytes(), &["OBJ", "no faces"]);
    refused("a.obj", &with("f 1 2 4\n"), &["line 4", "vertex 4", "has 3"]);
    refused("a.obj", &with("f 1 2 0\n"), &["line 4", "vertex 0"]);
    refused("a.obj", &with("f 1 2 -4\n"), &["line 4", "vertex -4", "3 came before"]);
    refused("a.obj", &with("f -1 -2 -3\nv 0 0 1\nf 1 2\n"), &["line 6", "2 corners"]);
    refused("a.obj", &with("f 1 2 x\n"), &["line 4", "`x`"]);
    refused("a.obj", &with("f 1/2/3/4 2 3\n"), &["line 4", "`1/2/3/4`"]);
    refused("a.obj", &with("f 1 2 9223372036854775807\n"), &["line 4", "9223372036854775807"]);
    refused("a.obj", &with("f 1 2 6148914691236517206\n"), &["line 4", "6148914691236517206"]);
    refused("a.obj", &with("f 1 2 -9223372036854775808\n"), &["line 4", "-9223372036854775808"]);
    refused("a.obj", &with("f 1 2 99999999999999999999\n"), &["line 4", "99999999999999999999"]);
    refused("a.obj", b"v 0 0 0\nv 1 nan 0\n", &["line 2", "vertex 2", "nan"]);
    refused("a.obj", b"v 0 0 inf\n", &["line 1", "inf"]);
    refused("a.obj", b"v 1e999 0 0\n", &["line 1", "1e999"]);
    refused("a.obj", b"v 0 0 0 0\n", &["line 1", "vertex 1"]);
    refused("a.obj", b"v 0 0\n", &["line 1", "2 numbers"]);
    refused("a.obj", b"# x\nv 0 0 zero\n", &["line 2", "`zero`"]);
}

#[test]
fn off() {
    let vertices = "0 0 0\n1 0 0\n0 1 0\n";
    let with = |counts: &str, faces: &str| format!("OFF\n{counts}\n{vertices}{faces}").into_bytes();
    refused("a.off", b"", &["OFF", "ends before its header"]);
    refused("a.off", b"\xff\xfe\x00", &["line 1", "not text"]);
    refused("a.off", b"solid x\n", &["line 1", "does not begin with OFF"]);
    refused("a.off", b"XOFF\n1 1 1\n", &["line 1", "`XOFF`"]);
    refused("a.off", b"4OFF\n1 1 1\n", &["line 1", "three dimensions"]);
    refused("a.off", b"OFF BINARY\n", &["line 1", "binary"]);
    refused("a.off", b"OFF\n", &["ends before its counts"]);
    refused("a.off", b"OFF\n3 x 0\n", &["line 2", "`x`"]);
    refused("a.off", b"OFF\n0 0 0\n", &["no vertices"]);
    refused("a.off", &with("3 0 0", ""), &["no faces"]);
    refused("a.off", &with("4000000000 4000000000 0", "3 0 1 2\n"), &["line 6", "vertex 3 has 4 numbers"]);
    refused("a.off", b"OFF\n4000000000 1 0\n0 0 0\n", &["ends before vertex 1 of 4000000000"]);
    refused("a.off", &with("3 1 0", "3 0 1 3\n"), &["line 6", "face 0 names vertex 3", "are 3"]);
    refused("a.off", &with("3 1 0", "3 0 1 -1\n"), &["line 6", "vertex -1"]);
    refused("a.off", &with("3 2 0", "3 0 1 2\n2 0 1\n"), &["line 7", "face 1 has 2 corners"]);
    refused("a.off", &with("3 1 0", "4 0 1 2\n"), &["line 6", "4 corners", "3 numbers"]);
    refused("a.off", &with("3 1 0", "18446744073709551615 0 1 2\n"), &["line 6"]);
    refused("a.off", &with("3 2 0", "3 0 1 2\n"), &["ends before face 1 of 2"]);
    refused("a.off", &with("3 1 0", "3 0 1 2\n3 0 2 1\n"), &["line 7", "more lines"]);
    refused("a.off", b"OFF\n1 1 0\n0 nan 0\n", &["line 3", "vertex 0", "not finite"]);
    refused("a.off", b"OFF\n1 1 0\n0 0\n", &["line 3", "vertex 0 has 2 numbers"]);
}

#[test]
fn ply() {
    let text = String::from_utf8(files::ply_text()).unwrap();
    let changed = |from: &str, to: &str| {
        assert!(text.contains(from), "{from}");
        text.replacen(from, to, 1).into_bytes()
    };
    refused("a.ply", b"", &["PLY", "line 1"]);
    refused("a.ply", b"\x00\x01\x02", &["PLY", "line 1"]);
    refused("a.ply", &text.as_bytes()[..80], &["PLY", "line"]);
    refused("a.ply", &changed("format ascii 1.0\n", ""), &["PLY", "format"]);
    refused("a.ply", &changed("vertex 4", "vertex 4000000000"), &["header counts 4000000000", "`vertex`"]);
    refused("a.ply", &changed("vertex 4", "vertex 18446744073709551615"), &["header counts"]);
    refused("a.ply", &changed("vertex 4", "vertex 99999999999999999999"), &["PLY", "line 4"]);
    refused("a.ply", &changed("vertex 4", "vertex 5"), &["PLY"]);
    refused("a.ply", &changed("vertex 4", "vertex 3"), &["line 15", "face 0 of 4"]);
    refused("a.ply", &changed("element face", "element tristrips"), &["triangle strips"]);
    refused("a.ply", &changed("face 4", "face 3"), &["more data"]);
    refused("a.ply", &changed("face 4", "face 5"), &["line", "face 4 of 5", "ends before"]);
    refused("a.ply", &changed("float x", "float y"), &["given twice"]);
    refused("a.ply", &changed("float x", "float u"), &["line 12", "vertex 0 lacks x"]);
    refused("a.ply", &changed("vertex_indices", "strip"), &["line 16", "face 0 has no list"]);
    refused("a.ply", &changed("0 1.5 0", "0 nan 0"), &["line 13", "vertex 1 of 4", "nan"]);
    refused("a.ply", &changed("0 1.5 0", "0 1e99 0"), &["line 13", "vertex 1", "not finite"]);
    refused("a.ply", &changed("3 0 1 3", "3 0 1 4"), &["line 17", "face 1 names vertex 4", "are 4"]);
    refused("a.ply", &changed("3 0 1 3", "3 0 1 -4"), &["line 17", "face 1", "below zero"]);
    refused("a.ply", &changed("3 0 1 3", "2 0 1"), &["line 17", "face 1 has 2 corners"]);
    refused("a.ply", &changed("3 0 1 3", "3 0 1"), &["line 17", "face 1"]);
    refused("a.ply", &changed("3 0 1 3", "3 0 1 3 9"), &["line 17", "4 numbers are wanted, 5"]);
    let binary = files::ply_binary(false);
    let faces = binary.len() - 4 * 13;
    refused("b.ply", &binary[..binary.len() - 1], &["face 3 of 4", &format!("byte {}", binary.len() - 13)]);
    refused("b.ply", &binary[..faces], &["header counts 4 of element `face`"]);
    refused("b.ply", &[&binary[..], b"x"].concat(), &["more data", &format!("byte {}", binary.len())]);
    let mut bad = binary.clone();
    bad[faces + 1] = 9;
    refused("b.ply", &bad, &[&format!("byte {faces}"), "face 0 names vertex 9"]);
    let mut none = binary[..faces].to_vec();
    none.extend([0; 52]);
    refused("b.ply", &none, &["face 0 has 0 corners"]);
    refused(
        "b.ply",
        b"ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\nend_header\n",
        &["no properties"],
    );
}

#[test]
fn stl() {
    let binary = files::stl_binary(b"x");
    refused("a.stl", b"", &["STL", "0 bytes"]);
    refused("a.stl", &[0; 84], &["no vertices"]);
    refused("a.stl", &binary[..200], &["byte 80", "4 facets", "200 bytes", "room for 2"]);
    refused("a.stl", &[&binary[..], &[0]].concat(), &["byte 80", "4 facets"]);
    let mut infinite = binary.clone();
    infinite[84 + 50 + 12..84 + 50 + 16].copy_from_slice(&f32::INFINITY.to_le_bytes());
    refused("a.stl", &infinite, &["facet 1", "byte 134", "not finite"]);
    let text = String::from_utf8(files::stl_text()).unwrap();
    refused("a.stl", text.replace("endsolid\n", "").as_bytes(), &["ends before `endsolid`"]);
    refused("a.stl", &text.as_bytes()[..150], &["ends before `endsolid`"]);
    refused("a.stl", text.replacen("1.5", "inf", 1).as_bytes(), &["facet 0", "line 2", "finite"]);
    refused("a.stl", text.replacen("1.5", "1,5", 1).as_bytes(), &["facet 0", "line 2"]);
    refused("a.stl", text.replacen("endloop", "vertex 0 0 0", 1).as_bytes(), &["facet 0"]);
    refused("a.stl", b"solid x\nendsolid x\n", &["no vertices"]);
}

/// The tetrahedron's document with one value replaced.
fn with(pointer: &str, value: Value) -> Vec<u8> {
    let (builder, parts) = files::tetrahedron();
    let mut document: Value = serde_json::from_slice(&builder.gltf(parts)).unwrap();
    let (parent, key) = pointer.rsplit_once('/').unwrap();
    match document.pointer_mut(parent).unwrap() {
        Value::Array(list) => list[key.parse::<usize>().unwrap()] = value,
        object => object[key] = value,
    }
    document.to_string().into_bytes()
}

#[test]
fn gltf() {
    refused("a.gltf", b"", &["glTF", "cannot be parsed"]);
    refused("a.gltf", b"{}", &["glTF", "asset"]);
    refused("a.gltf", b"\xff\x00", &["glTF", "cannot be parsed"]);
    refused("a.gltf", br#"{"asset":{"version":"2.0"}}"#, &["glTF", "no vertices"]);
    refused("a.gltf", &with("/nodes/0/mesh", json!(1)), &["nodes[0].mesh"]);
    let positions = "/meshes/0/primitives/0/attributes/POSITION";
    refused("a.gltf", &with(positions, json!(9)), &["mesh 0, primitive 0", "accessor 9"]);
    refused(
        "a.gltf",
        &with("/extensionsRequired", json!(["KHR_draco_mesh_compression"])),
        &["extensionsRequired", "draco"],
    );
    refused("a.gltf", &with("/buffers/0/byteLength", json!(1000)), &["buffer 0", "1000 bytes"]);
    refused("a.gltf", &with("/buffers/0/uri", json!("data:;base64,A*==")), &["buffer 0", "byte 1"]);
    refused("a.gltf", &with("/buffers/0/uri", json!("data:;base64,AAAAA")), &["buffer 0", "cut short"]);
    refused("a.gltf", &with("/buffers/0/uri", json!("data:text/plain,AAAA")), &["buffer 0", "not base64"]);
    refused("a.gltf", &with("/bufferViews/0/byteLength", json!(47)), &["accessor 0", "past the end of buffer view 0"]);
    refused("a.gltf", &with("/bufferViews/0/byteOffset", json!(u64::MAX)), &["accessor 0"]);
    refused("a.gltf", &with("/bufferViews/0/byteStride", json!(4)), &["accessor 0", "stride"]);
    refused("a.gltf", &with("/accessors/0/count", json!(u32::MAX)), &["accessor 0", "past the end"]);
    refused("a.gltf", &with("/accessors/0/count", json!(u64::MAX)), &["accessor 0", "past the end"]);
    refused("a.gltf", &with("/accessors/0/count", json!(3)), &["primitive 0", "index 5 is 3", "3 vertices"]);
    refused("a.gltf", &with("/accessors/0/type", json!("VEC2")), &["accessor 0", "2 numbers"]);
    refused("a.gltf", &with("/accessors/0/componentType", json!(7)), &["glTF", "accessors[0]"]);
    refused("a.gltf", &with("/accessors/1/componentType", json!(5126)), &["accessor 1"]);
    refused("a.gltf", &with("/nodes/0/children", json!([0])), &["own ancestors"]);
    refused("a.gltf", &with("/nodes/0/rotation", json!([0, 0, 0, 0])), &["node 0", "zero quaternion"]);
    refused("a.gltf", &with("/nodes/0/scale", json!([1e30, 1e30, 1e39])), &["glTF"]);
    refused("a.gltf", &with("/nodes/0/skin", json!(0)), &["nodes[0].skin"]);
    refused("a.gltf", &with("/scenes/0/nodes", json!([0, 0])), &["node 0", "twice"]);
    refused("a.gltf", &with("/scene", json!(3)), &["scene"]);
    let (builder, parts) = files::tetrahedron();
    let glb = builder.glb(parts);
    for cut in [5, 12, 19, 30, glb.len() - 1] {
        refused("a.glb", &glb[..cut], &["glTF"]);
    }
    refused("a.glb", b"glTF\x02\0\0\0\x05\0\0\0", &["byte 8", "5 bytes"]);
    let mut nan = builder;
    nan.bytes[16..20].copy_from_slice(&f32::NAN.to_le_bytes());
    refused("a.gltf", &nan.gltf(files::tetrahedron().1), &["primitive 0", "vertex 1", "not finite"]);
}

#[test]
fn a_missing_buffer_file_is_the_hosts_error() {
    let error = load("a.gltf", &with("/buffers/0/uri", json!("none.bin"))).unwrap_err();
    assert!(error.passing && error.message.contains("none.bin"), "{error}");
}
