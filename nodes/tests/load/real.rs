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
fn every_file_loads() {
    let Some(data) = data() else { return };
    for path in files(&data) {
        let mesh = read(&path);
        let defects: Vec<_> = mesh.defects.iter().map(ToString::to_string).collect();
        if !defects.is_empty() {
            let (v, f) = (mesh.vertices.len(), mesh.faces.len());
            println!("{}: {v} vertices, {f} faces; {}", path.file_name().unwrap().display(), defects.join("; "));
        }
    }
}

fn distance(p: [f64; 3], q: [f64; 3]) -> f64 {
    (0..3).map(|k| (p[k] - q[k]).powi(2)).sum::<f64>().sqrt()
}

/// For each vertex of `reference` the vertex of `mesh` nearest to it, with the largest distance.
fn nearest(reference: &Mesh, mesh: &Mesh) -> (Vec<usize>, f64) {
    let mut worst: f64 = 0.0;
    let of = |p: &[f64; 3]| {
        let by = |v: &usize| distance(*p, mesh.vertices[*v]);
        let best = (0..mesh.vertices.len()).min_by(|a, b| by(a).total_cmp(&by(b))).unwrap();
        worst = worst.max(by(&best));
        best
    };
    (reference.vertices.iter().map(of).collect(), worst)
}

/// Corners of each face from its lowest vertex on, sorted: equal for equal surfaces.
fn surface(faces: impl Iterator<Item = [usize; 3]>) -> Vec<[usize; 3]> {
    let turned = |[a, b, c]: [usize; 3]| {
        let turns = [[a, b, c], [b, c, a], [c, a, b]];
        *turns.iter().min().unwrap()
    };
    let mut out: Vec<_> = faces.map(turned).collect();
    out.sort_unstable();
    out
}

/// Checks a skinned file against poses that another program wrote: the rest pose to the sixth decimal of the files, and
/// with the same faces; poses within `slack`, because that program interpolated rotations along the chord, where glTF
/// wants the arc (with chords all poses agree to 2e-5); poses at keys, `exact`, again to the sixth decimal.
fn compare(glb: &str, folder: &str, prefix: &str, slack: f64, poses: &[(&str, f64, u32)], exact: &[(&str, u32)]) {
    let Some(data) = data() else { return };
    let (glb, folder) = (data.join("gltf").join(glb), data.join(folder));
    let rest = read(&folder.join(format!("{prefix}__rest.off")));
    let mine = read(&glb);
    let (map, worst) = nearest(&rest, &mine);
    assert!(worst < 1e-6, "{worst}");
    let distinct: std::collections::BTreeSet<_> = map.iter().collect();
    assert_eq!((mine.vertices.len(), distinct.len()), (rest.vertices.len(), rest.vertices.len()));
    let given = rest.faces.iter().map(|f| f.map(|v| map[v as usize]));
    assert_eq!(surface(given), surface(mine.faces.iter().map(|f| f.map(|v| v as usize))));
    for (clip, duration, percent) in poses {
        let given = read(&folder.join(format!("{prefix}__{clip}_{percent}.off")));
        let posed = posed(&glb, clip, duration * f64::from(*percent) / 100.0);
        assert_eq!((&posed.faces, &posed.source), (&mine.faces, &mine.source));
        let off = map.iter().zip(&given.vertices).map(|(v, p)| distance(posed.vertices[*v], *p));
        let worst = off.fold(0.0, f64::max);
        println!("{prefix} {clip} {percent} %: within {worst:.1e}");
        let allowed = if exact.contains(&(clip, *percent)) { 1e-6 } else { slack };
        assert!(worst < allowed, "{clip} {percent}: {worst}");
    }
}

#[test]
fn cesium_man_agrees_with_poses_of_another_program() {
    let poses = [10, 30, 50, 70, 90].map(|p| ("Anim_0", 2.0, p));
    compare("CesiumMan.glb", "cesium_man", "CesiumMan", 1e-4, &poses, &[("Anim_0", 50)]);
}

#[test]
fn fox_agrees_with_poses_of_another_program() {
    // The fox is 150 units long.
    let clips = [("Survey", 3.416_666_7), ("Walk", 0.708_333_3), ("Run", 1.158_333_3)];
    let poses = [10, 30, 50, 70, 90].map(|p| clips.map(|(clip, duration)| (clip, duration, p)));
    compare("Fox.glb", "khronos_fox", "Fox", 0.5, poses.as_flattened(), &[]);
}

#[test]
fn horse_agrees_with_poses_of_another_program() {
    let clips = [
        ("Attack_Headbutt", 1.033_333_333_333_333_3),
        ("Walk", 1.166_666_666_666_666_7),
        ("Gallop", 0.6),
        ("Death", 1.0),
    ];
    let poses = [33, 66].map(|p| clips.map(|(clip, duration)| (clip, duration, p)));
    compare("Horse.gltf", "quadrupeds/Horse", "Horse", 3e-4, poses.as_flattened(), &[]);
}
