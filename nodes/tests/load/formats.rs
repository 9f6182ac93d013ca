//! Sound files of every format.

use salient_sdk::testing::TestHost;
use salient_sdk::{AnyNode, DefectKind, Mesh};

use super::files::{self, FACES, points};
use super::{defect, load, load_with, params};
use salient_nodes::load::Load;

fn tetrahedron() -> Mesh {
    Mesh { vertices: points(), faces: FACES.to_vec(), ..Mesh::default() }
}

#[test]
fn the_same_tetrahedron_comes_out_of_every_format() {
    let (builder, parts) = files::tetrahedron();
    let cases = [
        ("a.obj", files::obj()),
        ("a.off", files::off()),
        ("a.ply", files::ply_text()),
        ("b.ply", files::ply_binary(false)),
        ("c.PLY", files::ply_binary(true)),
        ("a.gltf", builder.gltf(parts.clone())),
        ("a.glb", builder.glb(parts)),
    ];
    for (name, bytes) in cases {
        assert_eq!(load(name, &bytes).unwrap_or_else(|e| panic!("{name}: {e}")), tetrahedron(), "{name}");
    }
}

#[test]
fn stl_of_both_kinds_is_welded_into_the_same_tetrahedron() {
    // The first facet has the corners 0, 2, 1, and welding numbers by first appearance.
    let order = [0, 2, 1, 3];
    let vertices = order.map(|v| points()[v]).to_vec();
    let faces = FACES.map(|f| f.map(|v| order.iter().position(|o| *o == v as usize).unwrap() as u32));
    let expected = Mesh { vertices, faces: faces.to_vec(), source: Some(vec![0, 1, 2, 5]), ..Mesh::default() };
    let upper = String::from_utf8(files::stl_text()).unwrap().to_uppercase().into_bytes();
    let headers: [&[u8]; 2] = [b"exported", b"solid but binary"];
    let binary = headers.map(files::stl_binary);
    for bytes in [files::stl_text(), upper, binary[0].clone(), binary[1].clone()] {
        assert_eq!(load("a.stl", &bytes).unwrap(), expected);
    }
    let split = load_with("a.stl", &binary[0], &[("weld", "Never")]).unwrap();
    assert_eq!((split.vertices.len(), split.faces[3], split.source.is_none()), (12, [9, 10, 11], true));
    assert_eq!(defect(&split, DefectKind::DuplicateVertex).unwrap().count, 8);
    assert_eq!(defect(&split, DefectKind::SeveralComponents).unwrap().count, 3);
}

#[test]
fn several_solids_of_a_text_file_are_one_mesh() {
    let two = [files::stl_text(), b"\n".to_vec(), files::stl_text()].concat();
    let mesh = load("a.stl", &two).unwrap();
    assert_eq!((mesh.vertices.len(), mesh.faces.len()), (4, 8));
}

#[test]
fn obj_keeps_the_numbering_of_its_v_lines() {
    // Vertex 1 is unused, vertex 5 used before 3, faces name later vertices, objects and groups alternate.
    let text = "mtllib none.mtl\r\nv 9 9 9\r\nv 0 0 0 1.0\r\no first\r\nf 2// 5/7/8 \\\r\n 3\r\nv 1 0 0 0.5 0.5 0.5\r\n\
        usemtl x\r\no second\r\nv 0 1 0 # comment\r\nv 0 0 2 2\r\nvt 0\r\nvn nonsense\r\nl 1 2 3 4\r\np 1\r\n\
        f -4/1/1 -3 -2\r\ng third\r\nf 3 5 4\r\nf 2 4 5\r\n";
    let mesh = load("a.obj", text.as_bytes()).unwrap();
    let expected = [[9.0, 9.0, 9.0], [0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    assert_eq!(mesh.vertices, expected);
    assert_eq!(mesh.faces, [[1, 4, 2], [1, 2, 3], [2, 4, 3], [1, 3, 4]]);
    assert_eq!(mesh.source, None);
    let lone = defect(&mesh, DefectKind::UnreferencedVertex).unwrap();
    assert_eq!((lone.count, &lone.first[..], lone.repaired), (1, &[0][..], false));
}

#[test]
fn obj_coordinates_are_doubles() {
    let mesh = load("a.obj", b"v 0.1 0 0\nv 1e300 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    assert_eq!((mesh.vertices[0][0], mesh.vertices[1][0]), (0.1, 1e300));
}

#[test]
fn off_in_its_variants() {
    let body = |vertices: &str| format!("{vertices}\n3 0 1 2\n3 0 2 1 0.5 0.5 0.5\n");
    let plain = "0 0 0\n1 0 0\n0 1 0";
    let colour = "0 0 0 1 0 0 1\n1 0 0 1 0 0 1\n0 1 0 1 0 0 1";
    let normal = "0 0 0 0 0 1\n1 0 0 0 0 1\n0 1 0 0 0 1";
    let both = "0 0 0 0 0 1 9 9 9 9\n1 0 0 0 0 1 9 9 9 9\n0 1 0 0 0 1 9 9 9 9";
    let cases = [
        format!("OFF\n3 2 0\n{}", body(plain)),
        format!("\u{feff}# comment\n\nOFF 3 2 # counts\n\n# more\n{}\n\n", body(plain)),
        format!("OFF3 2 0\r\n{}", body(plain)),
        format!("COFF\n3 2 0\n{}", body(colour)),
        format!("OFF\n3 2 0\n{}", body(colour)),
        format!("NOFF\n3 2 0\n{}", body(normal)),
        format!("CNOFF\n3 2 0\n{}", body(both)),
    ];
    for text in cases {
        let mesh = load("a.off", text.as_bytes()).unwrap_or_else(|e| panic!("{text}: {e}"));
        assert_eq!(mesh.vertices, [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        assert_eq!(mesh.faces, [[0, 1, 2], [0, 2, 1]]);
    }
}

#[test]
fn ply_with_doubles_other_elements_and_blank_lines() {
    let text = "ply\r\nformat ascii 1.0\r\nobj_info x\r\nelement face 1\r\nproperty uchar flag\r\nproperty list int uint vertex_index\r\n\
        element edge 1\r\nproperty int a\r\nproperty list uchar float w\r\nelement vertex 3\r\nproperty double y\r\nproperty double x\r\nproperty int z\r\nend_header\r\n\
        7 3 0 1 2\r\n\r\n5 2 0.5 0.5\r\n0 0 0\r\n0.1 2 3\r\n1 0 0\r\n\r\n";
    let mesh = load("a.ply", text.as_bytes()).unwrap();
    assert_eq!(mesh.vertices, [[0.0; 3], [2.0, 0.1, 3.0], [0.0, 1.0, 0.0]]);
    assert_eq!(mesh.faces, [[0, 1, 2]]);
}

/// Triangles of one polygon in OFF.
fn split(points: &[[f64; 3]]) -> Vec<[u32; 3]> {
    let n = points.len();
    let rows: String = points.iter().map(|[x, y, z]| format!("{x} {y} {z}\n")).collect();
    let names: String = (0..n).map(|i| format!(" {i}")).collect();
    let mesh = load("a.off", format!("OFF\n{n} 1 0\n{rows}{n}{names}\n").as_bytes()).unwrap();
    let polygon = defect(&mesh, DefectKind::Polygon).unwrap();
    assert_eq!((polygon.count, &polygon.first[..], polygon.repaired), (1, &[0][..], true));
    mesh.faces
}

/// Area of the polygon in the plane z = 0 by the shoelace formula, and of its triangles with their signs.
fn areas(p: &[[f64; 3]], faces: &[[u32; 3]]) -> (f64, Vec<f64>) {
    let shoelace = |q: &[[f64; 3]]| {
        (0..q.len())
            .map(|i| {
                let (a, b) = (q[i], q[(i + 1) % q.len()]);
                a[0] * b[1] - a[1] * b[0]
            })
            .sum::<f64>()
            / 2.0
    };
    (shoelace(p), faces.iter().map(|f| shoelace(&f.map(|v| p[v as usize]))).collect())
}

#[test]
fn quads_are_split_along_the_shorter_inner_diagonal() {
    assert_eq!(split(&[[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [4.0, 1.0, 0.0], [1.0, 1.0, 0.0]]), [[0, 1, 3], [1, 2, 3]]);
    assert_eq!(split(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]), [[0, 1, 2], [0, 2, 3]]);
    // An arrowhead: corner 3 is reflex, and the diagonal 0-2 runs outside although it is the shorter one.
    let arrow = [[0.0, 0.0, 0.0], [2.0, 5.0, 0.0], [-2.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let faces = split(&arrow);
    assert_eq!(faces, [[0, 1, 3], [1, 2, 3]]);
    assert!(areas(&arrow, &faces).1.iter().all(|a| *a > 0.0));
}

#[test]
fn polygons_that_are_not_convex_are_covered_exactly() {
    let star: Vec<_> = (0..14)
        .map(|i| {
            let (r, a) = (if i % 2 == 0 { 3.0 } else { 1.0 }, f64::from(i) * std::f64::consts::TAU / 14.0);
            [r * a.cos(), r * a.sin(), 0.0]
        })
        .collect();
    let comb = [
        [0.0, 0.0, 0.0],
        [5.0, 0.0, 0.0],
        [5.0, 3.0, 0.0],
        [4.0, 3.0, 0.0],
        [4.0, 1.0, 0.0],
        [3.0, 1.0, 0.0],
        [3.0, 3.0, 0.0],
        [2.0, 3.0, 0.0],
        [2.0, 1.0, 0.0],
        [1.0, 1.0, 0.0],
        [1.0, 3.0, 0.0],
        [0.0, 3.0, 0.0],
    ];
    for polygon in [&star[..], &comb] {
        let faces = split(polygon);
        assert_eq!(faces.len(), polygon.len() - 2);
        let (whole, parts) = areas(polygon, &faces);
        // With no part turned over, equal areas mean that the parts cover the polygon once.
        assert!(parts.iter().all(|a| *a >= 0.0), "{parts:?}");
        assert!((parts.iter().sum::<f64>() - whole).abs() < 1e-12);
    }
    let hexagon: Vec<_> = (0..6)
        .map(|i| {
            let a = f64::from(i) * std::f64::consts::TAU / 6.0;
            [a.cos(), a.sin(), 0.0]
        })
        .collect();
    assert_eq!(split(&hexagon), [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]]);
}

#[test]
fn a_gltf_buffer_may_be_a_file_beside_it() {
    let (builder, parts) = files::tetrahedron();
    let mut document = builder.document(parts);
    document["buffers"][0]["uri"] = "my%20data.bin".into();
    let host = TestHost::default().file("path", document.to_string().as_bytes()).file_beside(
        "path",
        "my data.bin",
        &builder.bytes,
    );
    assert_eq!(host.run::<Load>(&params("a.gltf", &[]), ()).unwrap(), tetrahedron());
}

#[test]
fn base64_of_every_length() {
    // Three buffers of lengths 12 + 0, 1, 2 modulo 3 are read through one document each.
    for extra in 0..3 {
        let (mut builder, parts) = files::tetrahedron();
        builder.bytes.extend(vec![0xff; extra]);
        assert_eq!(load("a.gltf", &builder.gltf(parts)).unwrap(), tetrahedron());
    }
}

#[test]
fn the_node_is_documented() {
    let infos = Load.params();
    assert!(infos.iter().all(|i| !i.doc.is_empty()), "{infos:?}");
    let weld = infos.iter().find(|i| i.name == "weld").unwrap();
    assert_eq!((weld.form.as_str(), weld.default.clone()), ("Auto | Always | Never", Some("Auto".into())));
    let refused = |fields: &[(&str, &str)]| {
        let errors = Load.bind(fields).err().unwrap_or_default();
        errors.into_iter().map(|e| e.param).collect::<Vec<_>>()
    };
    assert_eq!(refused(&[("path", "\"a.3ds\"")]), ["path"]);
    assert_eq!(refused(&[("path", "\"a.obj\""), ("animation", "\"Run\"")]), ["animation"]);
    assert_eq!(refused(&[("path", "\"a.glb\""), ("time", "1")]), ["time"]);
    assert_eq!(refused(&[("path", "\"a.glb\""), ("animation", "\"Run\""), ("time", "-1")]), ["time"]);
    assert_eq!(refused(&[("path", "\"a.glb\""), ("wled", "Never")]), ["wled"]);
    assert!(refused(&[("path", "\"a.glb\""), ("animation", "\"Run\""), ("time", "1")]).is_empty());
}
