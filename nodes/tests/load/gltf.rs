//! Skins, clips, morph targets and node transforms, against values worked out by hand.

use salient_sdk::{DefectKind, Mesh, NodeError};
use serde_json::{Value, json};

use super::files::{Builder, FACES, POINTS, points, tetrahedron};
use super::{defect, load, load_with};

const H: f64 = std::f64::consts::FRAC_1_SQRT_2;

fn near(p: [f64; 3], q: [f64; 3], slack: f64) {
    assert!((0..3).all(|k| (p[k] - q[k]).abs() <= slack), "{p:?} is not {q:?}");
}

fn at(file: &[u8], clip: &str, time: f64) -> Result<Mesh, NodeError> {
    let (clip, time) = (format!("{clip:?}"), time.to_string());
    load_with("a.gltf", file, &[("animation", &clip), ("time", &time)])
}

fn posed(file: &[u8], clip: &str, time: f64) -> Vec<[f64; 3]> {
    at(file, clip, time).unwrap_or_else(|e| panic!("{clip} {time}: {e}")).vertices
}

/// A bar of four corners on two joints: the lower at (10, 0, 0), the upper one unit above it. Corner 3 hangs on the upper
/// joint, corner 4 half on each, by two sets of weights. The mesh's own node is moved, which must not matter.
pub fn bar() -> Vec<u8> {
    let mut b = Builder::default();
    let positions: [[f32; 3]; 5] =
        [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 2.0, 0.0], [0.0, 1.5, 0.0]];
    let positions = b.floats("VEC3", &positions);
    let corners = [0u8, 1, 4, 1, 3, 4, 3, 2, 4, 2, 0, 4, 0, 2, 1, 1, 2, 3].map(|v| [v]);
    let indices = b.bytes("SCALAR", &corners, false);
    let joints = b.bytes("VEC4", &[[0u8, 0, 0, 0], [0; 4], [0; 4], [1, 0, 0, 0], [0; 4]], false);
    let weights =
        b.bytes("VEC4", &[[255u8, 0, 0, 0], [255, 0, 0, 0], [255, 0, 0, 0], [255, 0, 0, 0], [51, 0, 0, 0]], true);
    let joints1 = b.bytes("VEC4", &[[0u8; 4], [0; 4], [0; 4], [0; 4], [1, 0, 0, 0]], false);
    let weights1 = b.floats("VEC4", &[[0f32; 4], [0.0; 4], [0.0; 4], [0.0; 4], [0.2, 0.0, 0.0, 0.0]]);
    let mut inverse = [[0f32; 16]; 2];
    for matrix in &mut inverse {
        for i in [0, 5, 10, 15] {
            matrix[i] = 1.0;
        }
    }
    inverse[1][13] = -1.0;
    let inverse = b.floats("MAT4", &inverse);
    let one = b.floats("SCALAR", &[[0f32], [1.0]]);
    let two = b.floats("SCALAR", &[[0f32], [2.0]]);
    let h = std::f32::consts::FRAC_1_SQRT_2;
    // The second quaternion is given with its sign turned: the arc must still be the short one.
    let turn = b.floats("VEC4", &[[0f32, 0.0, 0.0, 1.0], [0.0, 0.0, -h, -h]]);
    let steps = b.floats("VEC3", &[[0f32, 1.0, 0.0], [0.0, 3.0, 0.0]]);
    // In-tangent, value, out-tangent of each key.
    let spline = b.floats(
        "VEC3",
        &[[9f32, 9.0, 9.0], [0.0, 1.0, 0.0], [2.0, 0.0, 0.0], [0.0, 0.0, 4.0], [0.0, 3.0, 0.0], [9.0, 9.0, 9.0]],
    );
    let clip = |name: Value, input: usize, output: usize, how: &str, path: &str| {
        let mut clip = json!({
            "samplers": [{"input": input, "output": output, "interpolation": how}],
            "channels": [{"sampler": 0, "target": {"node": 2, "path": path}}],
        });
        if !name.is_null() {
            clip["name"] = name;
        }
        clip
    };
    b.gltf(json!({
        "scene": 0, "scenes": [{"nodes": [0, 3]}],
        "nodes": [
            {"translation": [10, 0, 0], "children": [1]},
            {"children": [2]},
            {"translation": [0, 1, 0]},
            {"mesh": 0, "skin": 0, "translation": [5, 5, 5], "scale": [-1, 3, 3]},
        ],
        "skins": [{"joints": [1, 2], "inverseBindMatrices": inverse}],
        "meshes": [{"primitives": [{"indices": indices, "attributes": {
            "POSITION": positions, "JOINTS_0": joints, "WEIGHTS_0": weights, "JOINTS_1": joints1, "WEIGHTS_1": weights1,
        }}]}],
        "animations": [
            clip(json!("Turn"), one, turn, "LINEAR", "rotation"),
            clip(json!("Step"), two, steps, "STEP", "translation"),
            clip(json!("Rise"), two, steps, "LINEAR", "translation"),
            clip(json!("Spline"), two, spline, "CUBICSPLINE", "translation"),
            clip(Value::Null, two, steps, "LINEAR", "translation"),
        ],
    }))
}

#[test]
fn a_skin_stands_as_its_joints_do() {
    let mesh = load("a.gltf", &bar()).unwrap();
    // Weights of 0.2 and 0.2 are brought to one half each.
    let expected = [[10.0, 0.0, 0.0], [11.0, 0.0, 0.0], [10.0, 0.0, 1.0], [10.0, 2.0, 0.0], [10.0, 1.5, 0.0]];
    mesh.vertices.iter().zip(expected).for_each(|(p, q)| near(*p, q, 1e-12));
    assert_eq!(mesh.faces[0], [0, 1, 4], "a mirrored node of a skinned mesh turns nothing");
}

#[test]
fn a_turning_joint_takes_its_vertices_along_the_arc() {
    // A quarter turn about z at (10, 1, 0): (10, 2, 0) goes to (9, 1, 0).
    let end = posed(&bar(), "Turn", 1.0);
    near(end[3], [9.0, 1.0, 0.0], 1e-7);
    near(end[4], [9.75, 1.25, 0.0], 1e-7);
    near(end[1], [11.0, 0.0, 0.0], 1e-12);
    let half = posed(&bar(), "Turn", 0.5);
    near(half[3], [10.0 - H, 1.0 + H, 0.0], 1e-7);
    // A third of a quarter turn is 30 degrees on the arc, but not on the chord.
    let third = posed(&bar(), "Turn", 1.0 / 3.0);
    near(third[3], [10.0 - 0.5, 1.0 + 0.75f64.sqrt(), 0.0], 1e-7);
}

#[test]
fn keys_are_interpolated_as_their_sampler_says() {
    let height = |clip: &str, time: f64| posed(&bar(), clip, time)[3];
    near(height("Step", 1.99), [10.0, 2.0, 0.0], 1e-12);
    near(height("Step", 2.0), [10.0, 4.0, 0.0], 1e-12);
    near(height("Rise", 0.5), [10.0, 2.5, 0.0], 1e-12);
    near(height("Anim_4", 1.5), [10.0, 3.5, 0.0], 1e-12);
    // Halfway a Hermite spline over 2 s: the mean of the values, and an eighth of 2 s times the tangents' difference.
    near(height("Spline", 1.0), [10.0 + 0.25 * 2.0, 2.0 + 1.0, -0.25 * 4.0], 1e-12);
    // At a quarter: h00 = 27/32, h10 = 9/64, h01 = 5/32, h11 = -3/64.
    let y = 27.0 / 32.0 + 3.0 * 5.0 / 32.0;
    near(height("Spline", 0.5), [10.0 + 2.0 * 2.0 * 9.0 / 64.0, 1.0 + y, -2.0 * 4.0 * 3.0 / 64.0], 1e-12);
    near(height("Spline", 0.0), [10.0, 2.0, 0.0], 1e-12);
    near(height("Spline", 2.0), [10.0, 4.0, 0.0], 1e-12);
}

#[test]
fn clips_and_times_that_are_not_there_are_refused() {
    let error = at(&bar(), "Run", 0.0).unwrap_err();
    assert!(error.message.contains("`Run`"), "{error}");
    assert_eq!(error.help.unwrap(), "clips of the file: `Turn`, `Step`, `Rise`, `Spline`, `Anim_4`");
    let error = at(&bar(), "Turn", 1.5).unwrap_err();
    assert!(error.message.contains("1.5 s") && error.help.unwrap().contains("to 1 s"), "{}", error.message);
}

#[test]
fn malformed_skins_and_clips_are_refused_with_their_place() {
    let with = |pointer: &str, value: Value, clip: bool| {
        let mut document: Value = serde_json::from_slice(&bar()).unwrap();
        *document.pointer_mut(pointer).unwrap() = value;
        let bytes = document.to_string().into_bytes();
        let result = if clip { at(&bytes, "Turn", 0.5) } else { load("a.gltf", &bytes) };
        result.err().unwrap_or_else(|| panic!("{pointer} was accepted")).message
    };
    let cases = [
        ("/skins/0/joints", json!([1]), false, "vertex 3 names joint 1"),
        ("/skins/0/inverseBindMatrices", json!(0), false, "skin 0, accessor 0"),
        ("/meshes/0/primitives/0/attributes/WEIGHTS_0", json!(0), false, "accessor 0"),
        ("/meshes/0/primitives/0/attributes/WEIGHTS_0", json!(2), false, "no joint has weight"),
        ("/animations/0/channels/0/target/node", json!(99), true, "node 99"),
        ("/animations/0/channels/0/target/path", json!("colour"), true, "animation 0, channel 0"),
        ("/animations/0/channels/0/sampler", json!(7), true, "animations[0].channels[0].sampler"),
        ("/animations/0/samplers/0/output", json!(0), true, "animation 0, channel 0"),
        ("/animations/0/samplers/0/input", json!(0), true, "animation 0, sampler 0"),
        ("/animations/0/samplers/0/interpolation", json!("CUBICSPLINE"), true, "animation 0, channel 0"),
        ("/accessors/9/count", json!(1), true, "animation 0, channel 0"),
    ];
    for (pointer, value, clip, expected) in cases {
        let message = with(pointer, value, clip);
        assert!(message.contains(expected), "{pointer}: {message}");
    }
}

#[test]
fn split_seams_are_closed_in_the_bind_pose_and_stay_closed() {
    // The tetrahedron without shared corners, each face's corners on a turning joint or not, alike at equal points.
    let mut b = Builder::default();
    let corners: Vec<usize> = FACES.as_flattened().iter().map(|v| *v as usize).collect();
    let positions = b.floats("VEC3", &corners.iter().map(|v| POINTS[*v]).collect::<Vec<_>>());
    let joints = b.bytes("VEC4", &corners.iter().map(|v| [u8::from(*v == 3), 0, 0, 0]).collect::<Vec<_>>(), false);
    let weights = b.floats("VEC4", &[[1f32, 0.0, 0.0, 0.0]; 12]);
    let times = b.floats("SCALAR", &[[0f32], [1.0]]);
    let moves = b.floats("VEC3", &[[0f32; 3], [0.1, 0.2, 0.3]]);
    let file = b.gltf(json!({
        "scenes": [{"nodes": [0, 1, 2]}], "nodes": [{}, {}, {"mesh": 0, "skin": 0}], "skins": [{"joints": [0, 1]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": positions, "JOINTS_0": joints, "WEIGHTS_0": weights}}]}],
        "animations": [{"name": "Go", "samplers": [{"input": times, "output": moves}],
            "channels": [{"sampler": 0, "target": {"node": 1, "path": "translation"}}]}],
    }));
    let rest = load("a.gltf", &file).unwrap();
    let moved = at(&file, "Go", 1.0).unwrap();
    assert_eq!((rest.vertices.len(), &rest.source), (4, &Some(vec![0, 1, 2, 5])));
    assert_eq!((&rest.faces, &rest.source, &moved.defects), (&moved.faces, &moved.source, &vec![]));
    near(moved.vertices[3], [0.1, 0.45, -1.95], 1e-7);
    assert_eq!(moved.vertices[..3], rest.vertices[..3]);
    let split = load_with("a.gltf", &file, &[("weld", "Never")]).unwrap();
    assert_eq!(split.vertices.len(), 12);
    assert_eq!(defect(&split, DefectKind::BoundaryEdge).unwrap().count, 12);
}

#[test]
fn node_transforms_apply_and_mirrors_turn_the_faces() {
    let (builder, mut parts) = tetrahedron();
    // Rotation of a quarter about x after a scale of (2, 1, 1), under a parent that is a matrix mirroring z.
    parts["nodes"] = json!([
        {"children": [1], "matrix": [1,0,0,0, 0,1,0,0, 0,0,-1,0, 1,2,3,1]},
        {"mesh": 0, "rotation": [H, 0, 0, H], "scale": [2, 1, 1], "translation": [0, 0, 1]},
    ]);
    let mesh = load("a.gltf", &builder.gltf(parts)).unwrap();
    for (p, [x, y, z]) in mesh.vertices.iter().zip(points()) {
        // About x: (x, y, z) -> (x, -z, y); then one up z; then mirrored and moved.
        near(*p, [2.0 * x + 1.0, -z + 2.0, -(y + 1.0) + 3.0], 1e-7);
    }
    assert_eq!(mesh.faces, FACES.map(|[a, b, c]| [a, c, b]));
}

#[test]
fn instances_are_parts_that_only_always_welds() {
    let (builder, mut parts) = tetrahedron();
    parts["nodes"] = json!([{"mesh": 0}, {"mesh": 0, "rotation": [0, 1, 0, 0]}, {"mesh": 0, "translation": [9, 9, 9]}]);
    parts["scenes"][0]["nodes"] = json!([1, 0]);
    let file = builder.gltf(parts);
    let mesh = load("a.gltf", &file).unwrap();
    assert_eq!((mesh.vertices.len(), mesh.faces.len(), mesh.faces[4]), (8, 8, [4, 6, 5]));
    assert_eq!(mesh.vertices[4..], points());
    assert!(!defect(&mesh, DefectKind::DuplicateVertex).unwrap().repaired);
    // The two share the axis of the half turn: corners 0 and 1.
    let welded = load_with("a.gltf", &file, &[("weld", "Always")]).unwrap();
    assert_eq!(welded.vertices.len(), 6);
    assert!(defect(&welded, DefectKind::DuplicateVertex).unwrap().repaired);
}

#[test]
fn strips_fans_and_plain_lists() {
    let square: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]];
    let faces = |mode: u32| {
        let mut b = Builder::default();
        let positions = b.floats("VEC3", &square);
        let parts = json!({"nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": positions}, "mode": mode}]}]});
        load("a.gltf", &b.gltf(parts)).map(|m| m.faces).map_err(|e| e.message)
    };
    assert_eq!(faces(4).unwrap(), [[0, 1, 2]]);
    assert_eq!(faces(5).unwrap(), [[0, 1, 2], [1, 3, 2]]);
    assert_eq!(faces(6).unwrap(), [[0, 1, 2], [0, 2, 3]]);
    assert!(faces(1).unwrap_err().contains("no vertices"));
}

#[test]
fn sparse_accessors_and_morph_targets() {
    let mut b = Builder::default();
    let positions = b.sparse_points(4, &[1, 2, 3], &[POINTS[1], POINTS[2], POINTS[3]]);
    let corners: Vec<[u8; 1]> = FACES.as_flattened().iter().map(|v| [*v as u8]).collect();
    let indices = b.bytes("SCALAR", &corners, false);
    let up = b.sparse_points(4, &[3], &[[0.0, 4.0, 0.0]]);
    let out = b.sparse_points(4, &[0], &[[-1.0, 0.0, 0.0]]);
    let times = b.floats("SCALAR", &[[0f32], [1.0]]);
    let weights = b.floats("SCALAR", &[[0f32], [0.0], [1.0], [0.5]]);
    let file = b.gltf(json!({
        "nodes": [{"mesh": 0}],
        "meshes": [{"weights": [0.25, 0.0], "primitives": [{"indices": indices, "attributes": {"POSITION": positions},
            "targets": [{"POSITION": up}, {"POSITION": out}]}]}],
        "animations": [{"name": "Grow", "samplers": [{"input": times, "output": weights}],
            "channels": [{"sampler": 0, "target": {"node": 0, "path": "weights"}}]}],
    }));
    let mesh = load("a.gltf", &file).unwrap();
    assert_eq!(mesh.vertices[..3], points()[..3]);
    near(mesh.vertices[3], [0.0, 1.25, -2.25], 1e-12);
    let half = posed(&file, "Grow", 0.5);
    near(half[3], [0.0, 2.25, -2.25], 1e-12);
    near(half[0], [-0.25, 0.0, 0.0], 1e-12);
}
