//! Thousands of mutated files of every format: each loads or is refused, and none panics.

use std::panic::{AssertUnwindSafe, catch_unwind};

use super::{files, load_with};

/// A small generator of reproducible numbers (xorshift).
struct Random(u64);

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as usize % n.max(1)
    }
}

const TOKENS: [&str; 24] = [
    "0",
    "-1",
    "1",
    "2",
    "3",
    "255",
    "65536",
    "4294967295",
    "4294967296",
    "9223372036854775807",
    "-9223372036854775808",
    "18446744073709551615",
    "1e999",
    "-nan",
    "inf",
    "\n",
    " ",
    "/",
    "#",
    "\\\n",
    "\u{e9}",
    "null",
    "[]",
    "\"\"",
];

/// Runs of digits of a text.
fn numbers(bytes: &[u8]) -> Vec<(usize, usize)> {
    let mut runs = Vec::new();
    let mut i = 0;
    while i < bytes.len() {
        let n = bytes[i..].iter().take_while(|b| b.is_ascii_digit()).count();
        if n > 0 {
            runs.push((i, i + n));
        }
        i += n.max(1);
    }
    runs
}

fn mutate(bytes: &[u8], random: &mut Random) -> Vec<u8> {
    let mut out = bytes.to_vec();
    for _ in 0..=random.below(3) {
        let at = random.below(out.len());
        match random.below(7) {
            0 if !out.is_empty() => out[at] = random.below(256) as u8,
            1 if !out.is_empty() => out[at] ^= 1 << random.below(8),
            2 => out.truncate(at),
            3 => {
                let end = (at + 1 + random.below(8)).min(out.len());
                out.drain(at..end);
            }
            4 => drop(out.splice(at..at, TOKENS[random.below(TOKENS.len())].bytes())),
            _ => {
                let runs = numbers(&out);
                let Some((from, to)) = runs.get(random.below(runs.len())).copied() else {
                    continue;
                };
                drop(out.splice(from..to, TOKENS[random.below(TOKENS.len())].bytes()));
            }
        }
    }
    out
}

/// Loads mutations of a file; returns how many were loaded.
fn survive(name: &str, bytes: &[u8], more: &[(&str, &str)], rounds: usize) -> usize {
    let mut random = Random(0x9e37_79b9_7f4a_7c15 ^ bytes.len() as u64);
    let mut loaded = 0;
    for round in 0..rounds {
        let mutated = mutate(bytes, &mut random);
        let result = catch_unwind(AssertUnwindSafe(|| load_with(name, &mutated, more)));
        let shown = || String::from_utf8_lossy(&mutated).into_owned();
        let result = result.unwrap_or_else(|_| panic!("{name}, round {round}, panics on: {}", shown()));
        if let Ok(mesh) = result {
            loaded += 1;
            let n = mesh.vertices.len() as u32;
            assert!(mesh.faces.as_flattened().iter().all(|v| *v < n), "{name}: {}", shown());
            assert!(mesh.vertices.as_flattened().iter().all(|x| x.is_finite()), "{name}: {}", shown());
        }
    }
    println!("{name}: {loaded} of {rounds} mutations still load");
    loaded
}

#[test]
fn mutated_files_never_panic() {
    let (builder, parts) = files::tetrahedron();
    let quad = b"OFF\n5 2 0\n0 0 0\n2 0 0\n2 2 0\n0 2 0\n1 1 0\n4 0 1 2 3\n5 0 1 4 2 3\n".to_vec();
    let cases = [
        ("a.obj", files::obj()),
        ("b.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0 1\nv 1 1 0\nvn 0 0 1\nvt 0 0\no x\nf 1/1/1 2/1/1 3//1 4\nusemtl m\nf -1 -2 -3\nl 1 2\n".to_vec()),
        ("a.off", files::off()),
        ("b.off", quad),
        ("a.ply", files::ply_text()),
        ("b.ply", files::ply_binary(false)),
        ("c.ply", files::ply_binary(true)),
        ("a.stl", files::stl_text()),
        ("b.stl", files::stl_binary(b"x")),
        ("a.gltf", builder.gltf(parts.clone())),
        ("a.glb", builder.glb(parts)),
    ];
    for (name, bytes) in cases {
        // A mutation that breaks every file would test nothing past the header.
        assert!(survive(name, &bytes, &[], 1500) > 30, "{name}");
    }
}

#[test]
fn mutated_skins_and_clips_never_panic() {
    let bar = super::gltf::bar();
    for (clip, time) in [("\"Turn\"", "0.5"), ("\"Spline\"", "1.0")] {
        assert!(survive("a.gltf", &bar, &[("animation", clip), ("time", time)], 2500) > 30);
    }
}
