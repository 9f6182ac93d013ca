//! Files by other people, where the data folder is present.

use std::path::{Path, PathBuf};

use salient_nodes::load::Load;
use salient_sdk::Mesh;
use salient_sdk::testing::TestHost;

use super::{load, params};

fn data() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data");
    let found = [folder.clone(), Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data")];
    let found = found.into_iter().find(|f| f.is_dir());
    if found.is_none() {
        println!("not run: there is no {}", folder.display());
    }
    found
}

/// All mesh files under a folder, sorted.
fn files(folder: &Path) -> Vec<PathBuf> {
    let mut out = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default();
        if path.is_dir() {
            out.extend(files(&path));
        } else if ["obj", "off", "glb", "gltf"].contains(&extension) {
            out.push(path);
        }
    }
    out.sort();
    out
}

fn read(path: &Path) -> Mesh {
    let name = path.file_name().unwrap().to_str().unwrap();
    load(name, &std::fs::read(path).unwrap()).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

fn posed(path: &Path, clip: &str, time: f64) -> Mesh {
    let name = path.file_name().unwrap().to_str().unwrap();
    let (clip, time) = (format!("{clip:?}"), time.to_string());
    let params = params(name, &[("animation", &clip), ("time", &time)]);
    let host = TestHost::default().file("path", &std::fs::read(path).unwrap());
    host.run::<Load>(&params, ()).unwrap_or_else(|e| panic!("{name} {clip} {time}: {e} {:?}", e.help))
}

#[test]
fn explore() {
    let Some(data) = data() else { return };
    for f in files(&data) {
        let m = read(&f);
        println!("{:?} {} {} {:?}", f.file_name().unwrap(), m.vertices.len(), m.faces.len(), m.defects.iter().map(|d| d.to_string()).collect::<Vec<_>>());
    }
    let m = posed(&data.join("gltf/CesiumMan.glb"), "Anim_0", 1.0);
    println!("{:?}", &m.vertices[..4]);
}
