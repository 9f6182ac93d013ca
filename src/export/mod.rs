//! Artefacts in the formats of other tools.
//!
//! Data go out as JSON, CSV, npz and safetensors; what can be drawn goes out as OBJ, PLY, OFF and GLB, by way of a [`Scene`]: a mesh as it is, a
//! function on a mesh as vertex colours, features as marks on it, a match as lines between two meshes side by side.

pub mod colour;
pub mod draw;
mod glb;
mod npz;
mod scene;

pub use colour::ColourMap;
pub use draw::{Drawing, draw};
pub use scene::Scene;

use clap::ValueEnum;
use salient_sdk::{AnyArtefact, ArtefactType, FormatError, Place, Table};

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
    /// What can be drawn of it as Wavefront OBJ.
    Obj,
    /// What can be drawn of it as binary PLY.
    Ply,
    /// What can be drawn of it as OFF.
    Off,
    /// What can be drawn of it as binary glTF, in single precision as that format has it.
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

    /// Whether it is a format of drawings.
    #[must_use]
    pub fn draws(self) -> bool {
        matches!(self, Self::Obj | Self::Ply | Self::Off | Self::Glb)
    }

    /// The formats that artefacts of a type can be written in; CSV only those that have a table.
    #[must_use]
    pub fn of(artefact: ArtefactType) -> Vec<Self> {
        let possible = |format: &Self| !format.draws() || artefact.place != Place::Nowhere;
        Self::value_variants().iter().copied().filter(possible).collect()
    }
}

/// An artefact that is not drawn as the bytes of a file.
pub fn export(artefact: &dyn AnyArtefact, format: Format) -> Result<Vec<u8>, FormatError> {
    match format {
        Format::Csv => {
            let none = || FormatError(format!("`{}` has no table to write as csv", artefact.type_name()));
            Ok(csv(&artefact.table().ok_or_else(none)?))
        }
        Format::Npz => npz::npz(&artefact.to_bytes()?.0),
        Format::Safetensors => Ok(artefact.to_bytes()?.0),
        Format::Json => {
            let mut bytes = serde_json::to_vec_pretty(&artefact.json()).map_err(|e| FormatError(e.to_string()))?;
            bytes.push(b'\n');
            Ok(bytes)
        }
        Format::Obj | Format::Ply | Format::Off | Format::Glb => {
            draw(artefact, &[], &Drawing::default())?.write(format)
        }
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

#[cfg(test)]
mod tests {
    use salient_sdk::{Artefact, Decoder, Encoder, Mesh};
    use serde_json::{Value, json};

    use super::*;

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
    fn what_an_artefact_cannot_give_is_refused() {
        assert!(export(&Bare, Format::Ply).unwrap_err().to_string().contains("nothing to draw of this `bare`"));
        assert!(export(&Bare, Format::Csv).unwrap_err().to_string().contains("no table"));
        assert_eq!(Format::of(ArtefactType::of::<Bare>()).len(), 4);
        assert_eq!(Format::of_extension("OBJ"), Some(Format::Obj));
        assert_eq!(Format::of_extension("xyz"), None);
    }
}
