//! Artefacts in the formats of other tools.

use std::fmt::Write as _;

use clap::ValueEnum;
use salient_sdk::{AnyArtefact, Decoder, FormatError, Mesh, Table};
use serde_json::json;

/// A file format.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Format {
    /// The artefact as JSON, with documented keys.
    Json,
    /// Its table, comma separated, with a header.
    Csv,
    /// Its arrays for `numpy.load`; `header` is a JSON text.
    Npz,
    /// Its arrays as the cache keeps them.
    Safetensors,
    /// Its surface as Wavefront OBJ.
    Obj,
    /// Its surface as binary PLY.
    Ply,
    /// Its surface as OFF.
    Off,
    /// Its surface as binary glTF, in single precision as that format has it.
    Glb,
}

impl Format {
    /// The extension of its files.
    #[must_use]
    pub fn extension(self) -> &'static str {
        match self {
            Self::Json => "json",
            Self::Csv => "csv",
            Self::Npz => "npz",
            Self::Safetensors => "safetensors",
            Self::Obj => "obj",
            Self::Ply => "ply",
            Self::Off => "off",
            Self::Glb => "glb",
        }
    }

    /// The format that an extension stands for, in any case.
    #[must_use]
    pub fn of_extension(extension: &str) -> Option<Self> {
        let extension = extension.to_lowercase();
        Self::value_variants().iter().copied().find(|format| format.extension() == extension)
    }

    /// The formats that an artefact can be written in.
    #[must_use]
    pub fn of(artefact: &dyn AnyArtefact) -> Vec<Self> {
        let possible = |format: &Self| match format {
            Self::Csv => artefact.table().is_some(),
            Self::Obj | Self::Ply | Self::Off | Self::Glb => artefact.surface().is_some(),
            _ => true,
        };
        Self::value_variants().iter().copied().filter(possible).collect()
    }
}

/// An artefact as the bytes of a file. The error says which formats there are.
pub fn export(artefact: &dyn AnyArtefact, format: Format) -> Result<Vec<u8>, FormatError> {
    let lacking = |what: &str| {
        let names: Vec<_> = Format::of(artefact).into_iter().map(Format::extension).collect();
        FormatError(format!(
            "`{}` has no {what} to write as {}; it can be written as {}",
            artefact.type_name(),
            format.extension(),
            names.join(", ")
        ))
    };
    let surface = || artefact.surface().ok_or_else(|| lacking("surface"));
    match format {
        Format::Json => {
            let mut bytes = serde_json::to_vec_pretty(&artefact.json()).map_err(|e| FormatError(e.to_string()))?;
            bytes.push(b'\n');
            Ok(bytes)
        }
        Format::Csv => Ok(csv(&artefact.table().ok_or_else(|| lacking("table"))?)),
        Format::Npz => npz(&artefact.to_bytes()?.0),
        Format::Safetensors => Ok(artefact.to_bytes()?.0),
        Format::Obj => Ok(obj(surface()?)),
        Format::Ply => Ok(ply(surface()?)),
        Format::Off => Ok(off(surface()?)),
        Format::Glb => glb(surface()?),
    }
}

/// A table as comma-separated values with a header.
#[must_use]
pub fn csv(table: &Table) -> Vec<u8> {
    let quote = |cell: &String| {
        if cell.contains(['"', ',', '\n', '\r']) { format!("\"{}\"", cell.replace('"', "\"\"")) } else { cell.clone() }
    };
    let line = |cells: &Vec<String>| cells.iter().map(quote).collect::<Vec<_>>().join(",") + "\n";
    let rows: String = table.rows.iter().map(line).collect();
    (line(&table.columns) + &rows).into_bytes()
}

fn obj(mesh: &Mesh) -> Vec<u8> {
    let mut text = String::new();
    // Writing to a string cannot fail. Numbers are the shortest that read back as the same.
    for [x, y, z] in &mesh.vertices {
        let _ = writeln!(text, "v {x} {y} {z}");
    }
    for face in &mesh.faces {
        let [a, b, c] = face.map(|i| i + 1);
        let _ = writeln!(text, "f {a} {b} {c}");
    }
    text.into_bytes()
}

fn off(mesh: &Mesh) -> Vec<u8> {
    let mut text = format!("OFF\n{} {} 0\n", mesh.vertices.len(), mesh.faces.len());
    for [x, y, z] in &mesh.vertices {
        let _ = writeln!(text, "{x} {y} {z}");
    }
    for [a, b, c] in &mesh.faces {
        let _ = writeln!(text, "3 {a} {b} {c}");
    }
    text.into_bytes()
}

fn ply(mesh: &Mesh) -> Vec<u8> {
    let header = format!(
        "ply\nformat binary_little_endian 1.0\n\
         element vertex {}\nproperty double x\nproperty double y\nproperty double z\n\
         element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        mesh.vertices.len(),
        mesh.faces.len()
    );
    let mut bytes = header.into_bytes();
    bytes.extend(mesh.vertices.as_flattened().iter().flat_map(|x| x.to_le_bytes()));
    for face in &mesh.faces {
        bytes.push(3);
        bytes.extend(face.iter().flat_map(|i| i.to_le_bytes()));
    }
    bytes
}

/// One mesh of one primitive: positions, then indices. glTF 2.0, sections 3.6, 3.7 and 4.4.
fn glb(mesh: &Mesh) -> Result<Vec<u8>, FormatError> {
    let positions: Vec<[f32; 3]> = mesh.vertices.iter().map(|p| p.map(|x| x as f32)).collect();
    if !positions.as_flattened().iter().all(|x| x.is_finite()) {
        return Err(FormatError("a coordinate is too large for glTF, which has single precision".into()));
    }
    let extreme = |of: fn(f32, f32) -> f32| {
        let first = positions.first().copied().unwrap_or_default();
        positions.iter().fold(first, |a, b| std::array::from_fn(|k| of(a[k], b[k])))
    };
    let mut binary: Vec<u8> = positions.as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect();
    let indices = binary.len();
    binary.extend(mesh.faces.as_flattened().iter().flat_map(|i| i.to_le_bytes()));
    let document = json!({
        "asset": {"version": "2.0", "generator": "salient"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {
                "bufferView": 0, "componentType": 5126, "type": "VEC3", "count": positions.len(),
                "min": extreme(f32::min), "max": extreme(f32::max),
            },
            {"bufferView": 1, "componentType": 5125, "type": "SCALAR", "count": 3 * mesh.faces.len()},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": indices, "target": 34962},
            {"buffer": 0, "byteOffset": indices, "byteLength": binary.len() - indices, "target": 34963},
        ],
        "buffers": [{"byteLength": binary.len()}],
    });
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let length =
        |n: usize| u32::try_from(n).map_err(|_| FormatError("a GLB holds at most 4 GB; write ply instead".into()));
    let mut bytes = b"glTF".to_vec();
    for number in [2, length(12 + 8 + text.len() + 8 + binary.len())?, length(text.len())?] {
        bytes.extend(number.to_le_bytes());
    }
    bytes.extend(b"JSON");
    bytes.extend(text);
    bytes.extend(length(binary.len())?.to_le_bytes());
    bytes.extend(b"BIN\0");
    bytes.extend(binary);
    Ok(bytes)
}

/// The arrays of an encoded artefact, and its header as a text array, as numpy's archive.
fn npz(artefact: &[u8]) -> Result<Vec<u8>, FormatError> {
    let decoder = Decoder::new(artefact)?;
    let mut zip = Zip::default();
    for array in decoder.arrays() {
        let dtype = if array.dtype == "f64" { "<f8" } else { "<u4" };
        zip.add(&format!("{}.npy", array.name), &npy(dtype, &array.shape, array.bytes))?;
    }
    let header = decoder.headers().to_string();
    let text: Vec<u8> = header.chars().flat_map(|c| (c as u32).to_le_bytes()).collect();
    zip.add("header.npy", &npy(&format!("<U{}", text.len() / 4), &[], &text))?;
    Ok(zip.finish())
}

/// An array in numpy's own layout, version 1.0.
fn npy(dtype: &str, shape: &[usize], bytes: &[u8]) -> Vec<u8> {
    let dims = shape.iter().fold(String::new(), |dims, n| format!("{dims}{n},"));
    let mut header = format!("{{'descr': '{dtype}', 'fortran_order': False, 'shape': ({dims})}}");
    // Magic, version and length take 10 bytes; the data begins at a multiple of 64.
    let padded = (10 + header.len() + 1).next_multiple_of(64) - 10;
    header.extend(std::iter::repeat_n(' ', padded - header.len() - 1));
    header.push('\n');
    let mut out = b"\x93NUMPY\x01\x00".to_vec();
    out.extend((header.len() as u16).to_le_bytes());
    out.extend(header.as_bytes());
    out.extend(bytes);
    out
}

/// A ZIP archive of files that are stored as they are, dated 1980 so that equal content gives equal
/// archives.
#[derive(Default)]
struct Zip {
    bytes: Vec<u8>,
    directory: Vec<u8>,
    count: u16,
}

impl Zip {
    fn add(&mut self, name: &str, content: &[u8]) -> Result<(), FormatError> {
        let too_large = |_| FormatError("an npz holds at most 4 GB; write safetensors instead".into());
        let size = u32::try_from(content.len()).map_err(too_large)?;
        let offset = u32::try_from(self.bytes.len()).map_err(too_large)?;
        u32::try_from(self.bytes.len() + content.len() + name.len() + 30).map_err(too_large)?;
        // Version, flags, method, time and date, as in both the local and the central header.
        let mut common: Vec<u8> = [20_u16, 0, 0, 0, 0x21].iter().flat_map(|x| x.to_le_bytes()).collect();
        for number in [crc32fast::hash(content), size, size] {
            common.extend(number.to_le_bytes());
        }
        common.extend((name.len() as u16).to_le_bytes());
        common.extend(0_u16.to_le_bytes());
        self.bytes.extend(b"PK\x03\x04");
        self.bytes.extend(&common);
        self.bytes.extend(name.as_bytes());
        self.bytes.extend(content);
        self.directory.extend(b"PK\x01\x02\x14\x00");
        self.directory.extend(&common);
        // Comment, disk, attributes: none.
        self.directory.extend([0; 10]);
        self.directory.extend(offset.to_le_bytes());
        self.directory.extend(name.as_bytes());
        self.count += 1;
        Ok(())
    }

    fn finish(mut self) -> Vec<u8> {
        let (start, size) = (self.bytes.len() as u32, self.directory.len() as u32);
        self.bytes.append(&mut self.directory);
        self.bytes.extend(b"PK\x05\x06\0\0\0\0");
        self.bytes.extend([self.count, self.count].iter().flat_map(|x| x.to_le_bytes()));
        self.bytes.extend([size, start].iter().flat_map(|x| x.to_le_bytes()));
        self.bytes.extend([0, 0]);
        self.bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use salient_sdk::{Artefact, Encoder};
    use serde_json::{Value, json};

    fn mesh() -> Mesh {
        Mesh {
            vertices: vec![[0.1, -2.0, 1e-9], [1.0, 0.0, 0.0], [0.0, 1.0 / 3.0, 0.0]],
            faces: vec![[0, 1, 2]],
            ..Mesh::default()
        }
    }

    struct Bare;
    impl Artefact for Bare {
        const TYPE: &'static str = "bare";
        const FORMAT: u32 = 1;
        const DOC: &'static str = "Nothing.";
        fn encode(&self, _: &mut Encoder) {}
        fn decode(_: &Decoder) -> Result<Self, FormatError> {
            Ok(Self)
        }
        fn json(&self) -> Value {
            json!({})
        }
        fn summary(&self) -> Vec<(&'static str, String)> {
            vec![]
        }
    }

    #[test]
    fn text_formats_read_back_exactly() {
        let text = |format| String::from_utf8(export(&mesh(), format).unwrap()).unwrap();
        let obj = text(Format::Obj);
        let read: Vec<f64> = obj
            .lines()
            .filter_map(|line| line.strip_prefix("v "))
            .flat_map(|line| line.split(' ').map(|x| x.parse().unwrap()).collect::<Vec<f64>>())
            .collect();
        assert_eq!(read, mesh().vertices.as_flattened());
        assert!(obj.ends_with("f 1 2 3\n"));
        assert!(text(Format::Off).starts_with("OFF\n3 1 0\n0.1 -2 0.000000001\n"));
        assert!(text(Format::Off).ends_with("3 0 1 2\n"));
        assert_eq!(text(Format::Csv).lines().nth(1), Some("0.1,-2,0.000000001"));
        let json: Value = serde_json::from_str(&text(Format::Json)).unwrap();
        assert_eq!(json["faces"], json!([[0, 1, 2]]));
    }

    #[test]
    fn ply_has_the_size_that_its_header_says() {
        let bytes = export(&mesh(), Format::Ply).unwrap();
        let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
        assert_eq!(bytes.len() - end, 3 * 24 + 13);
        assert_eq!(bytes[end..end + 8], 0.1_f64.to_le_bytes());
    }

    #[test]
    fn cells_with_commas_are_quoted() {
        let rows = vec![vec!["a,b".into(), "say \"x\"".into()]];
        let table = Table::new(&["one", "two"], rows);
        assert_eq!(csv(&table), b"one,two\n\"a,b\",\"say \"\"x\"\"\"\n");
    }

    #[test]
    fn npy_reads_back_with_npyz() {
        for (dtype, shape) in [("<f8", vec![2, 3]), ("<f8", vec![6]), ("<f8", vec![1; 40])] {
            let len = shape.iter().product::<usize>();
            let values: Vec<f64> = (0..len).map(|i| i as f64 / 7.0).collect();
            let bytes: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
            let file = npy(dtype, &shape, &bytes);
            assert_eq!((file.len() - bytes.len()) % 64, 0);
            let read = npyz::NpyFile::new(&file[..]).unwrap();
            assert_eq!(read.shape(), shape.iter().map(|n| *n as u64).collect::<Vec<_>>());
            assert_eq!(read.into_vec::<f64>().unwrap(), values);
        }
    }

    #[test]
    fn what_an_artefact_cannot_give_is_refused_with_what_it_can() {
        let error = export(&Bare, Format::Ply).unwrap_err().to_string();
        assert!(error.contains("no surface") && error.contains("json, npz, safetensors"), "{error}");
        assert!(export(&Bare, Format::Csv).unwrap_err().to_string().contains("no table"));
        assert_eq!(Format::of_extension("OBJ"), Some(Format::Obj));
        assert_eq!(Format::of_extension("xyz"), None);
    }
}
