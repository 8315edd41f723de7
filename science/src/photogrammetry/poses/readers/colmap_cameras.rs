//! COLMAP `cameras.txt` and `cameras.bin`: of each camera its id, model, width, height and parameters, which begin with
//! the focal length, px, or with one per axis.
//!
//! <https://colmap.github.io/format.html#cameras-txt>

use super::{colmap_binary::Rest, found::Found};
use crate::{
    photogrammetry::poses::{MAX_VIEWS, invalid},
    types::Error,
};

/// The camera models in the order of their ids.
const MODELS: &str = "SIMPLE_PINHOLE PINHOLE SIMPLE_RADIAL RADIAL OPENCV OPENCV_FISHEYE FULL_OPENCV FOV \
    SIMPLE_RADIAL_FISHEYE RADIAL_FISHEYE THIN_PRISM_FISHEYE RAD_TAN_THIN_PRISM_FISHEYE SIMPLE_DIVISION DIVISION \
    SIMPLE_FISHEYE FISHEYE EUCM EQUIRECTANGULAR";
/// How many focal lengths, and how many parameters, each model has.
const FOCAL_LENGTHS: [usize; 18] = [1, 2, 1, 1, 2, 2, 2, 2, 1, 1, 2, 2, 1, 2, 1, 2, 2, 0];
const PARAMETERS: [usize; 18] = [3, 4, 4, 5, 8, 8, 12, 5, 4, 5, 12, 16, 4, 5, 3, 4, 6, 2];

/// A camera of a file.
pub(super) struct Record {
    pub id: u32,
    /// Index of its model.
    model: usize,
    /// Width and height, px.
    pub size: [u64; 2],
    /// As many as its model has.
    pub parameters: Vec<f64>,
}

impl Record {
    /// Name of its model.
    pub(super) fn model(&self) -> &'static str {
        MODELS.split_ascii_whitespace().nth(self.model).unwrap_or("unknown")
    }

    /// The mean of its focal lengths. Cameras of this service have square pixels.
    fn focal_length(&self) -> Option<f64> {
        let count = FOCAL_LENGTHS[self.model];
        (count > 0).then(|| self.parameters[..count].iter().sum::<f64>() / count as f64)
    }
}

/// Adds the cameras of the file `name`.
pub(super) fn read(name: &str, bytes: &[u8], found: &mut Found) -> Result<(), Error> {
    for record in records(name, bytes, |record| record.focal_length().is_some())? {
        found.camera(record.id.to_string(), record.focal_length().unwrap_or_default());
    }
    Ok(())
}

/// The cameras of the file `name`, which must all be `usable`.
pub(super) fn records(name: &str, bytes: &[u8], usable: impl Fn(&Record) -> bool) -> Result<Vec<Record>, Error> {
    let mut rest = Rest { bytes, at: 0 };
    // a file that is not text is a damaged camera, and so is one that ends before the number of its cameras
    let text = str::from_utf8(bytes).unwrap_or("?").trim_start_matches('\u{feff}');
    let mut lines = text.lines().filter(|line| !line.starts_with('#') && !line.trim().is_empty());
    let is_binary = name.ends_with(".bin");
    let count = if is_binary { rest.take().map_or(1, u64::from_le_bytes) } else { lines.clone().count() as u64 };
    if count > MAX_VIEWS as u64 {
        return Err(invalid(format!(
            "{name}: {count} cameras; a scan has at most {MAX_VIEWS} views, each with one camera"
        )));
    }
    let camera = |at: u64| {
        let camera = if is_binary { of_record(&mut rest) } else { lines.next().and_then(of_line) };
        camera.filter(&usable).ok_or_else(|| {
            invalid(format!(
                "{name}: camera {at} of {count} is damaged, or its model is not known here or has no focal length; send the \
                 file of the images alone, and give focal_px"
            ))
        })
    };
    (1..=count).map(camera).collect()
}

fn of_line(line: &str) -> Option<Record> {
    let mut words = line.split_ascii_whitespace();
    let (id, name) = (words.next()?.parse().ok()?, words.next()?);
    let model = MODELS.split_ascii_whitespace().position(|known| known == name)?;
    let size = [words.next()?.parse().ok()?, words.next()?.parse().ok()?];
    let parameters: Vec<f64> =
        words.take(PARAMETERS[model] + 1).map(|word| word.parse().ok()).collect::<Option<_>>()?;
    (parameters.len() == PARAMETERS[model]).then_some(Record { id, model, size, parameters })
}

fn of_record(rest: &mut Rest<'_>) -> Option<Record> {
    let id = u32::from_le_bytes(rest.take()?);
    let model = u32::from_le_bytes(rest.take()?) as usize;
    let size = [u64::from_le_bytes(rest.take()?), u64::from_le_bytes(rest.take()?)];
    let parameters = (0..*PARAMETERS.get(model)?).map(|_| rest.numbers().map(|[number]| number));
    Some(Record { id, model, size, parameters: parameters.collect::<Option<_>>()? })
}
