//! The contracts that every node author relies on.

use std::fs::File;
use std::io::{Read, Seek};
use std::sync::Arc;

use safetensors::SafeTensors;
use salient_sdk::testing::TestHost;
use salient_sdk::{
    AnyArtefact, AnyNode, ArtefactType, Context, Decoder, FileParam, Inputs, Mesh, Node, NodeError, Port, PortValues,
    WriteError, Written,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;

/// How to weight.
#[derive(Serialize, Deserialize, JsonSchema)]
enum Weight {
    /// All alike.
    Uniform,
    /// By a number.
    By(f64),
    /// Between two.
    Between {
        /// The lower one.
        low: f64,
        /// The upper one, if there is one.
        high: Option<f64>,
    },
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Params {
    /// A file.
    path: FileParam,
    /// Radius in units of the mesh.
    #[serde(default = "one")]
    #[schemars(range(min = 0.5, max = 4.0))]
    radius: f64,
    /// Optional count.
    #[serde(default)]
    count: Option<u32>,
    /// A direction.
    #[serde(default)]
    toward: (f64, f64, f64),
    /// A limit.
    #[serde(default)]
    limit: Option<f64>,
    /// Weighting.
    #[serde(default = "uniform")]
    weight: Weight,
}

fn one() -> f64 {
    1.0
}
fn uniform() -> Weight {
    Weight::Uniform
}

struct In {
    mesh: Arc<Mesh>,
}
impl Inputs for In {
    const PORTS: &'static [Port] = &[Port::one::<Mesh>("mesh", "a mesh")];
    fn take(from: &mut PortValues) -> Result<Self, NodeError> {
        Ok(Self { mesh: from.one("mesh")? })
    }
}

struct Grow;
impl Node for Grow {
    const KIND: &'static str = "grow";
    const VERSION: u32 = 1;
    const DOC: &'static str = "Scales.";
    const EXAMPLE: &'static str = "";
    type Params = Params;
    type Inputs = In;
    type Output = Mesh;
    fn check(params: &Params) -> Vec<(&'static str, String)> {
        let bad = matches!(params.weight, Weight::By(w) if w > params.radius);
        if bad { vec![("weight", "heavier than the radius".into())] } else { vec![] }
    }
    fn run(params: &Params, inputs: In, cx: Context) -> Result<Mesh, NodeError> {
        let by = f64::from(cx.read("path")?[0]) * params.radius;
        let scaled = cx.map(&inputs.mesh.vertices, |_, p| Ok(p.map(|x| x * by)))?;
        Ok(Mesh { vertices: scaled, ..(*inputs.mesh).clone() })
    }
}

fn triangle() -> Mesh {
    Mesh {
        vertices: vec![[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 3.0, 0.0]],
        faces: vec![[0, 1, 2]],
        ..Mesh::default()
    }
}

fn bind(fields: &[(&str, &str)]) -> Vec<(String, String, std::ops::Range<usize>)> {
    let errors = Grow.bind(fields).err().unwrap_or_default();
    errors.into_iter().map(|e| (e.param, e.message, e.span)).collect()
}

#[test]
fn area_of_a_triangle() {
    assert!((triangle().area() - 3.0).abs() < 1e-15);
}

#[test]
fn artefacts_survive_the_trip_and_refuse_what_is_not_theirs() {
    let mesh = triangle();
    let (bytes, changed) = AnyArtefact::to_bytes(&mesh).unwrap();
    assert!(!changed);
    let back = (ArtefactType::of::<Mesh>().decode)(&bytes).unwrap();
    assert_eq!(back.to_bytes().unwrap().0, bytes);
    assert_eq!(*back.into_any().downcast::<Mesh>().unwrap(), mesh);
    for cut in [0, 7, 20, bytes.len() - 1] {
        assert!((ArtefactType::of::<Mesh>().decode)(&bytes[..cut]).is_err());
    }
}

#[test]
fn negative_zero_is_rewritten_and_nan_refused() {
    let mut mesh = triangle();
    mesh.vertices[0][0] = -0.0;
    let (bytes, changed) = AnyArtefact::to_bytes(&mesh).unwrap();
    assert!(changed);
    assert_eq!(bytes, AnyArtefact::to_bytes(&triangle()).unwrap().0);
    mesh.vertices[1][2] = f64::NAN;
    let error = AnyArtefact::to_bytes(&mesh).unwrap_err().to_string();
    assert!(error.contains("vertices") && error.contains('5'), "{error}");
}

#[test]
fn faces_past_the_vertices_are_refused_when_read() {
    let mesh = Mesh { faces: vec![[0, 1, 3]], ..triangle() };
    let (bytes, _) = AnyArtefact::to_bytes(&mesh).unwrap();
    assert!((ArtefactType::of::<Mesh>().decode)(&bytes).is_err());
}

#[test]
fn the_header_is_one_key_so_that_equal_artefacts_are_equal_bytes() {
    let (bytes, _) = AnyArtefact::to_bytes(&triangle()).unwrap();
    let from = Decoder::new(&bytes).unwrap();
    assert_eq!((from.kind(), from.format()), ("mesh", 1));
    let names: Vec<_> = from.arrays().into_iter().map(|a| (a.name, a.dtype, a.shape)).collect();
    assert_eq!(names[0], ("faces".to_owned(), "u32", vec![1, 3]));
    assert_eq!(names[1], ("vertices".to_owned(), "f64", vec![3, 3]));
}

/// More numbers than are converted at a time, and more arrays than one of each type.
fn strip() -> Mesh {
    let vertices: Vec<_> = (0..40_000).map(|i| [f64::from(i), f64::from(i % 2), 0.5]).collect();
    let faces = (2..40_000).map(|i| [i - 2, i - 1, i]).collect();
    Mesh { reference: Some(vertices.clone()), source: Some((0..40_000).collect()), vertices, faces, ..Mesh::default() }
}

#[test]
fn a_file_holds_the_bytes_that_the_library_writes() {
    let mesh = strip();
    let (bytes, _) = AnyArtefact::to_bytes(&mesh).unwrap();
    let mut file = tempfile::tempfile().unwrap();
    let written = mesh.write(&mut file).unwrap();
    assert_eq!(written, Written { bytes: bytes.len() as u64, changed: false });
    let mut found = Vec::new();
    file.rewind().unwrap();
    file.read_to_end(&mut found).unwrap();
    assert!(found == bytes);
    let (_, metadata) = SafeTensors::read_metadata(&bytes).unwrap();
    let tensors = SafeTensors::deserialize(&bytes).unwrap();
    assert_eq!(tensors.len(), 4);
    let again = safetensors::serialize(tensors.tensors(), metadata.metadata().clone()).unwrap();
    assert!(again == bytes);
}

#[test]
#[expect(clippy::disallowed_methods, reason = "a host, not a node")]
fn a_file_that_cannot_be_written_is_told_from_content_that_cannot() {
    let named = tempfile::NamedTempFile::new().unwrap();
    let mut sealed = File::open(named.path()).unwrap();
    assert!(matches!(strip().write(&mut sealed), Err(WriteError::Io(_))));
    let mesh = Mesh { vertices: vec![[f64::NAN; 3]; 3], ..triangle() };
    let mut file = tempfile::tempfile().unwrap();
    assert!(matches!(mesh.write(&mut file), Err(WriteError::Format(_))));
    assert_eq!(file.metadata().unwrap().len(), 0);
}

#[test]
fn params_are_typed_before_they_are_compared() {
    let integer = Grow.bind(&[("path", "\"a.off\""), ("radius", "2")]).unwrap();
    let float = Grow.bind(&[("radius", "2.0 // twice"), ("path", "\"a.off\"")]).unwrap();
    assert_eq!(integer.params().to_string(), float.params().to_string());
    let some = Grow.bind(&[("path", "\"a\""), ("count", "3"), ("weight", "By(0.5)")]).unwrap();
    assert_eq!(some.params()["count"], json!(3));
}

#[test]
fn every_wrong_param_is_found_with_its_place() {
    let errors = bind(&[("path", "3"), ("radius", "\"wide\""), ("weight", "Heavy")]);
    assert_eq!(errors.iter().map(|e| e.0.as_str()).collect::<Vec<_>>(), ["path", "radius", "weight"]);
    assert_eq!(bind(&[("radius", "2")])[0].1, "Unexpected missing field named `path` in `Params`");
    let range = &bind(&[("path", "\"a\""), ("radius", "9")])[0];
    assert_eq!((range.0.as_str(), range.1.as_str()), ("radius", "`radius` is 9; it must be from 0.5 to 4"));
    let between = &bind(&[("path", "\"a\""), ("weight", "By(3)")])[0];
    assert_eq!((between.0.as_str(), between.1.as_str()), ("weight", "heavier than the radius"));
}

#[test]
fn numbers_that_json_cannot_say_are_refused_wherever_they_stand() {
    let path = ("path", "\"a.obj\"");
    assert_eq!(bind(&[path, ("weight", "Between(low: 0, high: None)")]), []);
    assert_eq!(bind(&[path, ("limit", "None"), ("weight", "By(0.5)"), ("toward", "(0, 1e300, -1)")]), []);
    for (name, text) in [
        ("radius", "NaN"),
        ("radius", "1e999"),
        ("limit", "inf"),
        ("limit", "Some(-inf)"),
        ("toward", "(0, NaN, 0)"),
        ("weight", "By(inf)"),
        ("weight", "Between(low: -inf, high: None)"),
        ("weight", "Between(low: 0, high: inf)"),
    ] {
        let errors = bind(&[path, (name, text)]);
        assert_eq!(errors.len(), 1, "{name}: {text}: {errors:?}");
        assert_eq!((errors[0].0.as_str(), errors[0].1.contains("finite")), (name, true), "{errors:?}");
    }
}

#[test]
fn the_place_of_an_error_is_inside_its_value() {
    let text = "  By( /* heavy */ \"x\")";
    let errors = bind(&[("path", "\"a\""), ("weight", text)]);
    assert!(text[errors[0].2.clone()].contains('x') || errors[0].2.start >= 16, "{errors:?}");
}

#[test]
fn params_are_documented_by_their_schema() {
    let infos = AnyNode::params(&Grow);
    let find = |name: &str| infos.iter().find(|i| i.name == name).unwrap();
    assert!(find("path").file && find("path").default.is_none());
    assert_eq!(find("radius").range, (Some(0.5), Some(4.0)));
    assert_eq!(find("radius").default, Some(json!(1.0)));
    assert_eq!(find("radius").doc, "Radius in units of the mesh.");
    assert_eq!(find("weight").form, "Uniform | By(..) | Between(..)");
    assert_eq!(find("count").form, "integer");
}

#[test]
fn extensions_are_lower_case() {
    let extension = |name: &str| FileParam(name.into()).extension();
    assert_eq!(extension("a.b/Cat.OBJ"), "obj");
    assert_eq!(extension("a.b/cat"), "");
}

#[test]
fn a_node_runs_in_memory_on_any_number_of_workers() {
    let params: Params = salient_sdk::params::parse(&[("path", "\"a\"")]).unwrap();
    let run = |workers| {
        let host = TestHost::with_workers(workers).file("path", &[3]);
        host.run::<Grow>(&params, In { mesh: triangle().into() }).unwrap()
    };
    assert_eq!(run(0), run(3));
    assert_eq!(run(0).vertices[1], [6.0, 0.0, 0.0]);
}

#[test]
fn the_first_failing_item_is_the_one_reported() {
    let host = TestHost::with_workers(3);
    let items: Vec<usize> = (0..500).collect();
    for _ in 0..20 {
        let result = Context::new(&host)
            .map(&items, |i, _| if i % 100 == 42 { Err(NodeError::new(format!("item {i}"))) } else { Ok(i) });
        assert_eq!(result.unwrap_err().message, "item 42");
    }
}

#[test]
fn a_panic_on_a_borrowed_worker_keeps_its_message() {
    let here = std::thread::current().id();
    let host = TestHost::with_workers(2);
    let began = std::sync::atomic::AtomicBool::new(false);
    let elsewhere = |_, (): &()| {
        if std::thread::current().id() != here {
            began.store(true, std::sync::atomic::Ordering::SeqCst);
            panic!("item 7 is bad");
        }
        while !began.load(std::sync::atomic::Ordering::SeqCst) {
            std::thread::yield_now();
        }
        Ok(())
    };
    let map = || Context::new(&host).map(&[(); 64], elsewhere).map(drop);
    let panic = std::panic::catch_unwind(std::panic::AssertUnwindSafe(map)).unwrap_err();
    assert_eq!(panic.downcast_ref::<&str>(), Some(&"item 7 is bad"));
}

#[test]
fn a_stopped_run_stops_the_map() {
    let host = TestHost::default();
    host.cancel();
    assert!(Context::new(&host).map(&[1], |_, x| Ok(*x)).unwrap_err().cancelled);
}

#[test]
fn a_wrong_wire_is_an_error_not_a_panic() {
    let mut wired = PortValues::default();
    assert_eq!(In::take(&mut wired).err().unwrap().message, "nothing is wired to `mesh`");
    wired.push("mesh", "", Arc::new(triangle()));
    assert_eq!(In::take(&mut wired).unwrap().mesh.vertices.len(), 3);
}
