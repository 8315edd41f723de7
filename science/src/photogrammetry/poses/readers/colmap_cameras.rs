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

/// Adds the cameras of the file `name`.
pub(super) fn read(name: &str, bytes: &[u8], found: &mut Found) -> Result<(), Error> {
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
    for at in 1..=count {
        let camera = if is_binary { of_record(&mut rest) } else { lines.next().and_then(of_line) };
        let (id, focal_px) = camera.ok_or_else(|| {
            invalid(format!(
                "{name}: camera {at} of {count} is damaged, or its model is not known here or has no focal length; send the \
                 file of the images alone, and give focal_px"
            ))
        })?;
        found.camera(id.to_string(), focal_px);
    }
    Ok(())
}

fn of_line(line: &str) -> Option<(u32, f64)> {
    let mut words = line.split_ascii_whitespace();
    let (id, name) = (words.next()?.parse().ok()?, words.next()?);
    let model = MODELS.split(' ').position(|known| known == name)?;
    Some((id, focal_length(model, words.skip(2).map(|word| word.parse().ok()))?))
}

fn of_record(rest: &mut Rest<'_>) -> Option<(u32, f64)> {
    let id = u32::from_le_bytes(rest.take()?);
    let model = u32::from_le_bytes(rest.take()?) as usize;
    rest.take::<16>()?;
    let parameters = (0..*PARAMETERS.get(model)?).map(|_| rest.numbers().map(|[number]| number));
    Some((id, focal_length(model, parameters)?))
}

/// The mean of the focal lengths of a camera. Cameras of this service have square pixels.
fn focal_length(model: usize, parameters: impl Iterator<Item = Option<f64>>) -> Option<f64> {
    let parameters: Vec<f64> = parameters.take(PARAMETERS[model] + 1).collect::<Option<_>>()?;
    let count = FOCAL_LENGTHS[model];
    let is_whole = parameters.len() == PARAMETERS[model] && count > 0;
    is_whole.then(|| parameters[..count].iter().sum::<f64>() / count as f64)
}
