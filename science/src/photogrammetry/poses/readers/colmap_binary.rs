//! COLMAP `images.bin`, little endian: the number of images, and of each its id (u32), quaternion (4 f64), translation
//! (3 f64), camera (u32), name (ends with 0), number of points (u64) and points of 24 bytes.
//!
//! <https://colmap.github.io/format.html#binary-file-format>

use super::found::{Found, MAX_NAME, colmap_pose};
use crate::{photogrammetry::poses::invalid, types::Error};

/// Size of a point: two coordinates and the id of its 3D point.
const POINT_BYTES: u64 = 24;

pub(super) fn read(bytes: &[u8], found: &mut Found) -> Result<(), Error> {
    let mut rest = Rest { bytes, at: 0 };
    let images = u64::from_le_bytes(rest.take().ok_or_else(|| truncated(0))?);
    for image in 0..images {
        let place = || format!("image {} of {images}", image + 1);
        let record = rest.image().ok_or_else(|| truncated(image))?;
        let not_utf8 = || invalid(format!("{}: its name is not UTF-8; rename the image in UTF-8 or ASCII", place()));
        let pose = colmap_pose(record.name.ok_or_else(not_utf8)?, record.quaternion, record.translation)
            .ok_or_else(|| invalid(format!("{}: the quaternion has no length", place())))?;
        found.pose(pose, &record.camera.to_string(), place)?;
    }
    if rest.at < bytes.len() {
        return Err(invalid(format!(
            "the file goes on after the last of its {images} images: it is not an images.bin; of COLMAP, send images.bin \
             and not cameras.bin or points3D.bin"
        )));
    }
    Ok(())
}

fn truncated(image: u64) -> Error {
    invalid(format!(
        "the file ends within image {}: it is truncated, or not an images.bin; of COLMAP, send images.bin and not \
         cameras.bin or points3D.bin",
        image + 1
    ))
}

struct Record {
    quaternion: [f64; 4],
    translation: [f64; 3],
    camera: u32,
    /// `None` for one that is not UTF-8.
    name: Option<String>,
}

/// What is left of a file.
pub(super) struct Rest<'a> {
    pub bytes: &'a [u8],
    pub at: usize,
}

impl Rest<'_> {
    pub(super) fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let taken = self.bytes.get(self.at..self.at.checked_add(N)?)?;
        self.at += N;
        taken.try_into().ok()
    }

    pub(super) fn numbers<const N: usize>(&mut self) -> Option<[f64; N]> {
        let mut numbers = [0.0; N];
        for number in &mut numbers {
            *number = f64::from_le_bytes(self.take()?);
        }
        Some(numbers)
    }

    fn image(&mut self) -> Option<Record> {
        self.take::<4>()?;
        let (quaternion, translation) = (self.numbers()?, self.numbers()?);
        let camera = u32::from_le_bytes(self.take()?);
        let tail = self.bytes.get(self.at..)?;
        let length = tail.iter().take(MAX_NAME + 1).position(|byte| *byte == 0)?;
        let name = str::from_utf8(tail.get(..length)?).ok().map(str::to_owned);
        self.at += length + 1;
        let points = u64::from_le_bytes(self.take()?);
        let end = usize::try_from(points.checked_mul(POINT_BYTES)?).ok()?.checked_add(self.at)?;
        if end > self.bytes.len() {
            return None;
        }
        self.at = end;
        Some(Record { quaternion, translation, camera, name })
    }
}
