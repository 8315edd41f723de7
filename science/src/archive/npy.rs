//! Reads matrices from a numpy array file (`.npy`, format versions 1 to 3), and writes such files.
//!
//! Strict on purpose: `float32` or `float64`, and exactly as many bytes as the shape requires. Pickled objects are
//! refused and never unpickled.

use crate::types::{Error, ErrorKind, profile::MAX_SLICES};

/// The first bytes of every `.npy` file.
pub const MAGIC: &[u8; 6] = b"\x93NUMPY";

/// Maximum length of a header, bytes. The limit of numpy is 10,000.
const LONGEST_HEADER: usize = 16 << 10;

/// Bytes of a file that contain its shape: magic, version, length and header.
pub(super) const START_BYTES: u64 = 12 + LONGEST_HEADER as u64;

/// How the numbers of an array are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Number {
    Four,
    Eight,
}

/// The content of a header.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Layout {
    descr: String,
    fortran_order: bool,
    /// Elements along each axis.
    pub shape: Vec<u64>,
    /// Offset of the first number, bytes.
    data_at: usize,
}

impl Layout {
    /// True for N x 3 x 3 and N x 9.
    pub(super) fn is_of_matrices(&self) -> bool {
        matches!(self.shape.as_slice(), [_, 3, 3] | [_, 9])
    }

    /// The shape as numpy prints it.
    pub(super) fn shape_text(&self) -> String {
        let axes: Vec<String> = self.shape.iter().map(ToString::to_string).collect();
        match axes.as_slice() {
            [one] => format!("({one},)"),
            many => format!("({})", many.join(", ")),
        }
    }

    /// The type of the numbers, and whether they are big-endian.
    fn number(&self, file: &str) -> Result<(Number, bool), Error> {
        match self.descr.as_str() {
            "<f8" | "=f8" => Ok((Number::Eight, false)),
            ">f8" => Ok((Number::Eight, true)),
            "<f4" | "=f4" => Ok((Number::Four, false)),
            ">f4" => Ok((Number::Four, true)),
            other => {
                let dtype: String = other.chars().take(80).collect();
                Err(wrong(match other.contains('O') {
                    true => format!(
                        "{file} holds Python objects (dtype '{dtype}'), which may hold anything and are never \
                         unpacked; save plain numbers: numpy.save(\"h.npy\", numpy.asarray(h, dtype=float))"
                    ),
                    false => {
                        format!("the numbers of {file} are of dtype '{dtype}'; save them as float64: h.astype(float)")
                    }
                }))
            }
        }
    }
}

/// Parses the header. `file` is the name for messages.
pub(super) fn layout(bytes: &[u8], file: &str) -> Result<Layout, Error> {
    let early = || wrong(format!("{file} ends within its header; was it cut off? Save and send it again"));
    let Some(rest) = bytes.strip_prefix(MAGIC) else {
        return Err(wrong(format!("{file} is not an array saved by numpy (.npy); save it with numpy.save")));
    };
    let &[major, minor, ref rest @ ..] = rest else { return Err(early()) };
    let (length, before) = match (major, rest) {
        (1, [a, b, ..]) => (usize::from(u16::from_le_bytes([*a, *b])), 10),
        (2 | 3, [a, b, c, d, ..]) => (usize::try_from(u32::from_le_bytes([*a, *b, *c, *d])).unwrap_or(usize::MAX), 12),
        (1..=3, _) => return Err(early()),
        _ => {
            return Err(wrong(format!(
                "{file} is of version {major}.{minor} of the .npy format; versions 1 to 3 are supported"
            )));
        }
    };
    if length > LONGEST_HEADER {
        return Err(wrong(format!(
            "the header of {file} has {length} bytes instead of about 100; save a plain array of numbers"
        )));
    }
    let header = bytes.get(before..before + length).ok_or_else(early)?;
    let header = std::str::from_utf8(header).map_err(|_| unclear(file))?;
    let (descr, fortran_order, shape) = Dictionary(header).read().ok_or_else(|| unclear(file))?;
    Ok(Layout { descr, fortran_order, shape, data_at: before + length })
}

/// The matrices of an array of shape N x 3 x 3 or N x 9, each row-major. `file` is the name for messages.
///
/// # Errors
/// [`ErrorKind::InvalidProfile`]: not a `.npy` file, Python objects, another dtype, another shape, more than 1000
/// matrices, or a number of bytes that does not match the shape.
pub fn matrices(bytes: &[u8], file: &str) -> Result<Vec<[f64; 9]>, Error> {
    let layout = layout(bytes, file)?;
    // objects first: their shape is meaningless
    let (number, big) = layout.number(file)?;
    if !layout.is_of_matrices() {
        let shape = layout.shape_text();
        return Err(wrong(format!("{file} has the shape {shape} instead of N x 3 x 3 or N x 9, one matrix per slice")));
    }
    let count = layout.shape.first().copied().unwrap_or(0);
    let count = usize::try_from(count).ok().filter(|&count| count <= MAX_SLICES).ok_or_else(|| {
        let shape = layout.shape_text();
        wrong(format!(
            "{file} has the shape {shape}; a stack has at most {MAX_SLICES} slices: save the matrices of one stack only"
        ))
    })?;
    let size = match number {
        Number::Four => 4,
        Number::Eight => 8,
    };
    let data = bytes.get(layout.data_at..).unwrap_or_default();
    let (has, wants) = (data.len(), count * 9 * size);
    if has != wants {
        let why = if has < wants { "was it cut off?" } else { "it is not a single array" };
        let shape = layout.shape_text();
        return Err(wrong(format!("{file} has {has} bytes of numbers, but its shape {shape} needs {wants}; {why}")));
    }
    let value = |at: usize| {
        let piece = data.get(at * size..(at + 1) * size).unwrap_or_default();
        match (number, big) {
            (Number::Four, false) => piece.try_into().map_or(f64::NAN, |b| f64::from(f32::from_le_bytes(b))),
            (Number::Four, true) => piece.try_into().map_or(f64::NAN, |b| f64::from(f32::from_be_bytes(b))),
            (Number::Eight, false) => piece.try_into().map_or(f64::NAN, f64::from_le_bytes),
            (Number::Eight, true) => piece.try_into().map_or(f64::NAN, f64::from_be_bytes),
        }
    };
    let is_flat = layout.shape.len() == 2;
    let at = |slice: usize, element: usize| match (layout.fortran_order, is_flat) {
        (false, _) => slice * 9 + element,
        (true, true) => slice + count * element,
        // the first axis runs fastest: slice, row, column
        (true, false) => slice + count * (element / 3 + 3 * (element % 3)),
    };
    Ok((0..count).map(|slice| std::array::from_fn(|element| value(at(slice, element)))).collect())
}

/// An array of float64 in C order, as `numpy.save` writes it.
pub fn of_floats(shape: &[usize], values: impl IntoIterator<Item = f64>) -> Vec<u8> {
    written("<f8", shape, values.into_iter().flat_map(f64::to_le_bytes))
}

/// An array of int64 in C order; an empty shape is a single number.
pub fn of_integers(shape: &[usize], values: impl IntoIterator<Item = i64>) -> Vec<u8> {
    written("<i8", shape, values.into_iter().flat_map(i64::to_le_bytes))
}

fn written(descr: &str, shape: &[usize], data: impl Iterator<Item = u8>) -> Vec<u8> {
    let axes: String = match shape {
        [one] => format!("{one},"),
        many => many.iter().map(ToString::to_string).collect::<Vec<_>>().join(", "),
    };
    let mut header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({axes}), }}");
    // the format aligns the numbers to 64 bytes
    let padding = 63 - (10 + header.len()) % 64;
    header.extend(std::iter::repeat_n(' ', padding));
    header.push('\n');
    let mut out = MAGIC.to_vec();
    out.extend([1, 0]);
    // three axes of at most 20 digits: far below 65,535
    out.extend(u16::try_from(header.len()).unwrap_or(u16::MAX).to_le_bytes());
    out.extend(header.bytes());
    out.extend(data);
    out
}

pub(super) fn wrong(detail: String) -> Error {
    Error::new(ErrorKind::InvalidProfile, detail)
}

fn unclear(file: &str) -> Error {
    wrong(format!(
        "the header of {file} is not one of an array of plain numbers; save the array with numpy.save(\"h.npy\", numpy.asarray(h, \
         dtype=float))"
    ))
}

/// Parser of the Python dictionary in a header: exactly three known keys, in any order.
struct Dictionary<'a>(&'a str);

impl<'a> Dictionary<'a> {
    fn read(mut self) -> Option<(String, bool, Vec<u64>)> {
        let (mut descr, mut fortran_order, mut shape) = (None, None, None);
        self.mark("{")?;
        while self.mark("}").is_none() {
            let key = self.quoted()?;
            self.mark(":")?;
            match key {
                "descr" if descr.is_none() => descr = Some(self.quoted()?.to_owned()),
                "fortran_order" if fortran_order.is_none() => {
                    fortran_order = Some(self.mark("True").is_some() || self.mark("False").map(|()| false)?);
                }
                "shape" if shape.is_none() => shape = Some(self.numbers()?),
                _ => return None,
            }
            if self.mark(",").is_none() {
                self.mark("}")?;
                break;
            }
        }
        self.0.trim().is_empty().then_some(())?;
        Some((descr?, fortran_order?, shape?))
    }

    /// Consumes `mark` if it comes next.
    fn mark(&mut self, mark: &str) -> Option<()> {
        self.0 = self.0.trim_start().strip_prefix(mark)?;
        Some(())
    }

    fn quoted(&mut self) -> Option<&'a str> {
        let text = self.0.trim_start();
        let quote = text.chars().next().filter(|c| matches!(c, '\'' | '"'))?;
        let (inside, rest) = text.get(1..)?.split_once(quote)?;
        self.0 = rest;
        (!inside.contains('\\')).then_some(inside)
    }

    fn numbers(&mut self) -> Option<Vec<u64>> {
        self.mark("(")?;
        let (inside, rest) = self.0.split_once(')')?;
        self.0 = rest;
        let inside = inside.trim().strip_suffix(',').unwrap_or(inside.trim());
        if inside.is_empty() {
            return Some(Vec::new());
        }
        // Python 2 wrote an L after long numbers
        inside.split(',').map(|axis| axis.trim().trim_end_matches('L').parse().ok()).collect()
    }
}
