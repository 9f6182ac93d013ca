//! Arrays for `numpy.load`.

use salient_sdk::{Decoder, FormatError};

/// The arrays of an encoded artefact, and its header as a text array, as numpy's archive.
pub fn npz(artefact: &[u8]) -> Result<Vec<u8>, FormatError> {
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
pub(super) fn npy(dtype: &str, shape: &[usize], bytes: &[u8]) -> Vec<u8> {
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
}
