//! CSV with a header: `name`, `x`, `y`, `z`, and perhaps `pan_deg` and `tilt_deg`, in any order; comma, semicolon or
//! tab, with decimal commas where commas do not separate. `alt` is the `z` of RealityCapture. A row without a position
//! is a view that was not registered.

use std::io::{self, Read};

use super::found::{Found, shown};
use crate::{
    photogrammetry::poses::{Pose, invalid},
    types::Error,
};

/// A column, and the names that it may have.
const COLUMNS: [(&str, &[&str]); 6] = [
    ("name", &["name", "label", "image", "filename", "file"]),
    ("x", &["x", "cx", "center_x", "centre_x"]),
    ("y", &["y", "cy", "center_y", "centre_y"]),
    ("z", &["z", "cz", "center_z", "centre_z", "alt"]),
    ("pan_deg", &["pan_deg", "pan"]),
    ("tilt_deg", &["tilt_deg", "tilt"]),
];

/// Most bytes that are read for a row. The parser keeps every field of a row, with 8 bytes for its end.
const MAX_ROW: usize = 64 << 10;

/// The text, of which each row may read a limited part.
struct RowByRow<'a> {
    text: &'a [u8],
    /// What the present row may still read, bytes.
    left: usize,
}

impl Read for RowByRow<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.left == 0 && !self.text.is_empty() {
            return Err(io::Error::other("the row is too long"));
        }
        let most = buffer.len().min(self.left);
        let read = self.text.read(&mut buffer[..most])?;
        self.left -= read;
        Ok(read)
    }
}

/// The error for a row that cannot be read. `line`: where the row begins.
fn wrong(error: &csv::Error, line: u64) -> Error {
    if error.is_io_error() {
        let most = MAX_ROW >> 10;
        return invalid(format!(
            "line {line}: the row is longer than {most} KiB; close the quote that is open, or send the columns name, x, \
             y and z alone"
        ));
    }
    invalid(format!("the CSV cannot be read: {error}"))
}

pub(super) fn read(text: &str, found: &mut Found) -> Result<(), Error> {
    let header = text.lines().find(|line| !line.trim().is_empty()).unwrap_or_default();
    let delimiter = [b';', b'\t', b','].into_iter().find(|d| header.contains(char::from(*d))).unwrap_or(b',');
    let rows = RowByRow { text: text.as_bytes(), left: MAX_ROW };
    let mut reader =
        csv::ReaderBuilder::new().delimiter(delimiter).trim(csv::Trim::All).flexible(true).from_reader(rows);
    let header = reader.headers().map_err(|error| wrong(&error, 1))?.clone();
    // some programs write the header as a comment
    let heading = |field: &str| field.trim_start_matches('#').trim().to_ascii_lowercase();
    let columns = COLUMNS.map(|(_, names)| header.iter().position(|field| names.contains(&heading(field).as_str())));
    for ((name, _), column) in COLUMNS.iter().zip(&columns).take(4) {
        if column.is_none() {
            return Err(invalid(format!("the CSV has no column '{name}'; its first line must name the columns")));
        }
    }
    let mut record = csv::StringRecord::new();
    loop {
        reader.get_mut().left = MAX_ROW;
        let line = reader.position().line();
        if !reader.read_record(&mut record).map_err(|error| wrong(&error, line))? {
            return Ok(());
        }
        let place = || format!("line {line}");
        let field = |at: usize| columns[at].and_then(|column| record.get(column)).unwrap_or_default();
        let number = |at: usize| -> Result<Option<f64>, Error> {
            let text = field(at);
            if text.is_empty() {
                return Ok(None);
            }
            // where commas separate nothing, one is a decimal comma
            let number = if delimiter == b',' { text.to_owned() } else { text.replacen(',', ".", 1) };
            let value = number.parse::<f64>().ok().filter(|value| value.is_finite());
            let detail = || invalid(format!("line {line}: {} is '{}', not a number", COLUMNS[at].0, shown(text)));
            value.map(Some).ok_or_else(detail)
        };
        let name = field(0).to_owned();
        let angles = number(4)?.zip(number(5)?).map(|(pan, tilt)| [pan, tilt]);
        match (number(1)?, number(2)?, number(3)?) {
            (Some(x), Some(y), Some(z)) => {
                let pose = Pose { name, centre: [x, y, z], rotation: None, commanded_deg: angles };
                found.pose(pose, "", place)?;
            }
            (None, None, None) => found.unregistered(name, place)?,
            _ => return Err(invalid(format!("line {line}: of x, y and z one is missing"))),
        }
    }
}
