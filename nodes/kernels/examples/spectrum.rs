//! Eigenvalues of an OBJ file's mesh: `spectrum FILE.obj PAIRS [values]` prints size, time and certificate, and the values if asked.
#![expect(clippy::disallowed_methods, reason = "a program, not a node")]

use salient_kernels::eigen::{Options, eigenpairs};
use salient_kernels::laplacian::{Area, is_zero_area, laplacian};
use std::error::Error;
use std::time::Instant;

type Mesh = (Vec<[f64; 3]>, Vec<[u32; 3]>);

/// Positions and fan triangles, without zero-area faces and the vertices nothing refers to.
fn read_obj(text: &str) -> Result<Mesh, Box<dyn Error>> {
    let (mut points, mut faces) = (Vec::new(), Vec::new());
    for line in text.lines() {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                let x: Vec<f64> = words.take(3).map(str::parse).collect::<Result<_, _>>()?;
                points.push([x[0], x[1], x[2]]);
            }
            Some("f") => {
                let first = |w: &str| w.split('/').next().unwrap_or("").parse::<i64>();
                let ids: Vec<i64> = words.map(first).collect::<Result<_, _>>()?;
                let ids: Vec<u32> =
                    ids.iter().map(|&i| if i > 0 { i - 1 } else { points.len() as i64 + i } as u32).collect();
                faces.extend((2..ids.len()).map(|i| [ids[0], ids[i - 1], ids[i]]));
            }
            _ => {}
        }
    }
    faces.retain(|f: &[u32; 3]| !is_zero_area(f.map(|v| points[v as usize])));
    let mut new_index = vec![u32::MAX; points.len()];
    faces.iter().flatten().for_each(|&v| new_index[v as usize] = 0);
    let mut kept = Vec::new();
    for (old, new) in new_index.iter_mut().enumerate().filter(|e| *e.1 == 0) {
        *new = kept.len() as u32;
        kept.push(points[old]);
    }
    let faces = faces.iter().map(|f| f.map(|v| new_index[v as usize])).collect();
    Ok((kept, faces))
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [path, k, rest @ ..] = &arguments[..] else {
        return Err("usage: spectrum FILE.obj PAIRS [values] [delaunay]".into());
    };
    let has = |word: &str| rest.iter().any(|r| r == word);
    let (vertices, faces) = read_obj(&std::fs::read_to_string(path)?)?;
    let start = Instant::now();
    let operator = laplacian(&vertices, &faces, Area::Mixed, has("delaunay"))?;
    let assembled = start.elapsed();
    let start = Instant::now();
    let pairs = eigenpairs(&operator, k.parse()?, &Options::default(), &())?;
    println!(
        "n {} assembly {:.4} s eigen {:.4} s {:?}",
        pairs.n,
        assembled.as_secs_f64(),
        start.elapsed().as_secs_f64(),
        pairs.certificate
    );
    if has("values") {
        for value in &pairs.values {
            println!("{value:e}");
        }
    }
    Ok(())
}
