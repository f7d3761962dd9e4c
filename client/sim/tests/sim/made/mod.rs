//! MATLAB v5 files made in tests, little- or big-endian.

use flate2::Compression;
use flate2::write::ZlibEncoder;
use std::io::Write as _;

/// Makes elements in one byte order.
#[derive(Clone, Copy)]
pub(crate) struct Mat {
    pub(crate) big_endian: bool,
}

impl Mat {
    fn u32(self, value: u32) -> [u8; 4] {
        if self.big_endian { value.to_be_bytes() } else { value.to_le_bytes() }
    }

    pub(crate) fn element(self, kind: u32, data: &[u8]) -> Vec<u8> {
        let mut all = [self.u32(kind), self.u32(data.len() as u32)].concat();
        all.extend(data);
        all.resize(all.len().next_multiple_of(8), 0);
        all
    }

    /// Up to four bytes inside the tag.
    fn short(self, kind: u32, data: &[u8]) -> Vec<u8> {
        let mut all = self.u32((data.len() as u32) << 16 | kind).to_vec();
        all.extend(data);
        all.resize(8, 0);
        all
    }

    fn head(self, class: u32, dims: [usize; 2], name: &str) -> Vec<u8> {
        let dims: Vec<u8> = dims.into_iter().flat_map(|d| self.u32(d as u32)).collect();
        let flags = [self.u32(class), self.u32(0)].concat();
        let name = if name.len() <= 4 && !name.is_empty() {
            self.short(1, name.as_bytes())
        } else {
            self.element(1, name.as_bytes())
        };
        [self.element(6, &flags), self.element(5, &dims), name].concat()
    }

    pub(crate) fn numbers(self, name: &str, dims: [usize; 2], values: &[f64]) -> Vec<u8> {
        let bytes = |v: &f64| if self.big_endian { v.to_be_bytes() } else { v.to_le_bytes() };
        let data: Vec<u8> = values.iter().flat_map(bytes).collect();
        self.element(14, &[self.head(6, dims, name), self.element(9, &data)].concat())
    }

    /// A row of small whole numbers, kept as bytes.
    pub(crate) fn bytes(self, name: &str, values: &[u8]) -> Vec<u8> {
        self.element(14, &[self.head(9, [1, values.len()], name), self.element(2, values)].concat())
    }

    pub(crate) fn text(self, name: &str, text: &str) -> Vec<u8> {
        let units =
            text.encode_utf16().flat_map(|u| if self.big_endian { u.to_be_bytes() } else { u.to_le_bytes() });
        let data: Vec<u8> = units.collect();
        let data = if data.len() <= 4 { self.short(4, &data) } else { self.element(4, &data) };
        self.element(14, &[self.head(4, [1, text.chars().count()], name), data].concat())
    }

    pub(crate) fn cells(self, name: &str, cells: &[Vec<u8>]) -> Vec<u8> {
        self.element(14, &[self.head(1, [1, cells.len()], name), cells.concat()].concat())
    }

    pub(crate) fn fields(self, name: &str, fields: &[(&str, Vec<u8>)]) -> Vec<u8> {
        let mut names = Vec::new();
        for (field, _) in fields {
            names.extend(field.as_bytes());
            names.resize(names.len().next_multiple_of(16), 0);
        }
        let values: Vec<u8> = fields.iter().flat_map(|(_, value)| value.clone()).collect();
        let parts =
            [self.head(2, [1, 1], name), self.short(5, &self.u32(16)), self.element(1, &names), values]
                .concat();
        self.element(14, &parts)
    }

    pub(crate) fn compressed(self, element: &[u8]) -> Vec<u8> {
        let mut encoder = ZlibEncoder::new(Vec::new(), Compression::fast());
        encoder.write_all(element).unwrap();
        let data = encoder.finish().unwrap();
        [self.u32(15).to_vec(), self.u32(data.len() as u32).to_vec(), data].concat()
    }

    pub(crate) fn file(self, variables: &[Vec<u8>]) -> Vec<u8> {
        let mut file = b"MATLAB 5.0 MAT-file, made in a test".to_vec();
        file.resize(124, b' ');
        file.extend(if self.big_endian { [1, 0, b'M', b'I'] } else { [0, 1, b'I', b'M'] });
        file.extend(variables.concat());
        file
    }

    /// Two letters with padding, labels and a key, as the published train file has them.
    pub(crate) fn train_file(self, compress: bool) -> Vec<u8> {
        let a = [0.0, 0.0, 0.0, 1.0, 2.0, 0.5, 0.0, 0.0, 0.1, 3.0, -1.0, 0.5, 0.0, 0.0, 0.0];
        let b = [0.25, 0.5, 1.0, -0.25, 0.5, 1.0];
        let variables = [
            self.cells("xtrain", &[self.numbers("", [3, 5], &a), self.numbers("", [3, 2], &b)]),
            self.bytes("ytrain", &[2, 1]),
            self.cells("key", &[self.text("", "p"), self.text("", "qu\u{e9}")]),
        ];
        let variables = variables.map(|v| if compress { self.compressed(&v) } else { v });
        self.file(&variables)
    }
}

/// A recording of everything with 34 pen samples, 32 of them of use, in `chunks` with checksums or plain.
pub(crate) fn mcap(chunks: bool) -> Vec<u8> {
    let mut table = "layout 0 size 216\npen_samples 0 4 u32\npart 4 4 u32\n".to_owned();
    for index in 0..4 {
        let fields = [("stamp_ns", 0, "u64"), ("x_m", 8, "f64"), ("y_m", 16, "f64"), ("contact", 24, "u32")];
        for (name, offset, kind) in fields {
            table.push_str(&format!("pen[{index}].{name} {} 8 {kind}\n", 8 + 28 * index + offset));
        }
    }
    let options = mcap::WriteOptions::new().compression(None).use_chunks(chunks).emit_summary_records(chunks);
    let options = options.calculate_data_section_crc(chunks).calculate_summary_section_crc(chunks);
    let mut file = std::io::Cursor::new(Vec::new());
    let mut writer = options.create(&mut file).unwrap();
    let schema = writer.add_schema("TickInput", "foretrace.wire", table.as_bytes()).unwrap();
    let none = std::collections::BTreeMap::new();
    let channel = writer.add_channel(schema, "/raw/input", "foretrace.wire", &none).unwrap();
    let other = writer.add_channel(0, "/tick", "protobuf", &none).unwrap();
    let mut samples: Vec<(u64, f64, f64, u32)> =
        (0..30).map(|k| (k * 5_000_000, 1e-3 * k as f64, -5e-4 * k as f64, u32::from(k < 20))).collect();
    samples.push((245_000_000, 0.1, 0.1, 1));
    samples.push((245_000_000, 0.2, 0.2, 1));
    samples.push((248_000_000, f64::NAN, 0.0, 1));
    samples.push((250_000_000, 0.1, 0.1, 1));
    // Nine in a tick come in parts of four.
    for (tick, given) in samples.chunks(9).enumerate() {
        for (part, here) in given.chunks(4).enumerate() {
            let mut message = (given.len() as u32).to_le_bytes().to_vec();
            message.extend((part as u32).to_le_bytes());
            for (stamp_ns, x_m, y_m, contact) in here {
                message.extend((stamp_ns + 7_000_000_000).to_le_bytes());
                message.extend(x_m.to_le_bytes());
                message.extend(y_m.to_le_bytes());
                message.extend(contact.to_le_bytes());
            }
            message.resize(8 + 4 * 28, 0xff);
            for (channel_id, data) in [(channel, message.as_slice()), (other, b"not ours")] {
                let time = tick as u64;
                let header = mcap::records::MessageHeader {
                    channel_id,
                    sequence: 0,
                    log_time: time,
                    publish_time: time,
                };
                writer.write_to_known_channel(&header, data).unwrap();
            }
        }
    }
    writer.finish().unwrap();
    drop(writer);
    file.into_inner()
}
