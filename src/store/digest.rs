//! Digests: of profiles, which results record, and of files.

use std::{
    fs::File,
    io::{self, Read},
    path::Path,
};

use sha2::{Digest, Sha256};

use pinstack_science::types::{
    lateral_colour::LateralColour,
    profile::{CaptureMode, ProfileInput},
};

/// SHA-256 (hex) of what determines the pixels of a result: image size, reference slice, and for each slice the nine
/// elements of its homography and its gain (1 if absent); and the lens distortion, the lateral colour and the
/// orientation of the slices if they are given. Note, rail positions and origin are not included: profiles with the
/// same digest give the same image.
pub fn profile_digest(input: &ProfileInput) -> String {
    let mut hash = Sha256::new();
    hash.update(b"pinstack profile 1\0");
    for number in [input.image_width, input.image_height, input.reference_index] {
        hash.update(number.to_le_bytes());
    }
    for (index, homography) in input.homographies.iter().enumerate() {
        let gain = input.gain(index);
        for number in homography.0.into_iter().chain([gain]) {
            // -0.0 + 0.0 = 0.0: both zeros get the same digest
            hash.update((number + 0.0).to_le_bytes());
        }
    }
    if let Some(lens) = &input.distortion {
        hash.update(b"distortion\0");
        for number in [lens.centre_px[0], lens.centre_px[1], lens.k1, lens.k2, lens.radius_px] {
            hash.update((number + 0.0).to_le_bytes());
        }
    }
    if let Some(LateralColour { red, blue }) = &input.lateral_colour {
        hash.update(b"lateral colour\0");
        for number in [red, blue].into_iter().flat_map(|of| [of.scale, of.shift_px[0], of.shift_px[1]]) {
            hash.update((number + 0.0).to_le_bytes());
        }
    }
    if let Some(orientation) = input.orientation {
        hash.update(b"orientation\0");
        hash.update([orientation]);
    }
    hex(&hash.finalize())
}

/// SHA-256 (hex) of what a profile specifies about the camera: principal distance, principal point, pixel pitch,
/// magnification, capture mode and rail positions. EXIF, intrinsics and scales in mm follow from these. Together with
/// [`profile_digest`] it covers every number of a profile.
pub fn optics_digest(input: &ProfileInput) -> String {
    let mut hash = Sha256::new();
    hash.update(b"pinstack optics 1\0");
    let mut optional = |numbers: Option<&[f64]>| match numbers {
        None => hash.update([0]),
        Some(numbers) => {
            hash.update([1]);
            hash.update((numbers.len() as u64).to_le_bytes());
            for number in numbers {
                hash.update((number + 0.0).to_le_bytes());
            }
        }
    };
    for number in [input.principal_distance_mm, input.pixel_pitch_mm, input.magnification] {
        optional(number.as_ref().map(std::slice::from_ref));
    }
    optional(input.principal_point_px.as_ref().map(<[f64; 2]>::as_slice));
    optional(input.rail_positions_mm.as_deref());
    hash.update([match input.capture_mode {
        None => 0,
        Some(CaptureMode::FixedLens) => 1,
        Some(CaptureMode::MovingLens) => 2,
        Some(CaptureMode::LensAlone) => 3,
    }]);
    // profiles without these keep the digest of versions that did not know them
    let pupils = input.pupils.numbers();
    if input.principal_distance_source.is_some() || pupils.iter().any(|(_, number, _)| number.is_some()) {
        hash.update(b"pupils 1\0");
        for (_, number, _) in pupils {
            hash.update([u8::from(number.is_some())]);
            hash.update((number.unwrap_or_default() + 0.0).to_le_bytes());
        }
        hash.update([input.principal_distance_source.map_or(0, |source| source as u8 + 1)]);
    }
    hex(&hash.finalize())
}

/// Lower-case hex.
pub fn hex(bytes: &[u8]) -> String {
    use std::fmt::Write;
    bytes.iter().fold(String::with_capacity(bytes.len() * 2), |mut text, byte| {
        // writing to a String cannot fail
        let _ = write!(text, "{byte:02x}");
        text
    })
}

/// Size and SHA-256 (hex) of a file.
///
/// # Errors
/// When the file cannot be read.
pub fn sha256_of_file(path: &Path) -> io::Result<(u64, String)> {
    sha256_of(File::open(path)?)
}

/// Number and SHA-256 (hex) of the bytes that a reader returns.
///
/// # Errors
/// When the reader fails.
pub fn sha256_of(reader: impl Read) -> io::Result<(u64, String)> {
    let FileDigests { bytes, sha256, .. } = digests_of(reader)?;
    Ok((bytes, sha256))
}

/// Size and digests of a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FileDigests {
    /// Size, bytes.
    pub bytes: u64,
    /// SHA-256, hex.
    pub sha256: String,
    /// CRC-32 as in zips.
    pub crc32: u32,
}

/// Number and digests of the bytes that a reader returns.
///
/// # Errors
/// When the reader fails.
pub fn digests_of(mut reader: impl Read) -> io::Result<FileDigests> {
    let (mut hash, mut crc) = (Sha256::new(), crc32fast::Hasher::new());
    let mut block = vec![0; 1 << 20];
    let mut bytes = 0;
    loop {
        let read = reader.read(&mut block)?;
        if read == 0 {
            return Ok(FileDigests { bytes, sha256: hex(&hash.finalize()), crc32: crc.finalize() });
        }
        let block = block.get(..read).unwrap_or_default();
        hash.update(block);
        crc.update(block);
        bytes += read as u64;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pinstack_science::types::{
        Homography,
        lateral_colour::ColourDisplacement,
        pupils::{PrincipalDistanceSource, Pupils},
    };

    fn input() -> ProfileInput {
        ProfileInput {
            image_width: 640,
            image_height: 480,
            reference_index: 0,
            homographies: vec![Homography::IDENTITY, Homography::similarity(1.01, [0.5, -0.25])],
            gains: None,
            ..ProfileInput::default()
        }
    }

    #[test]
    fn the_digest_depends_on_the_geometry_and_not_on_the_note() {
        let base = profile_digest(&input());
        assert_eq!(base.len(), 64);
        assert_eq!(base, profile_digest(&ProfileInput { note: Some("of Tuesday".into()), ..input() }));
        assert_eq!(base, profile_digest(&ProfileInput { gains: Some(vec![1.0, 1.0]), ..input() }));
        assert_ne!(base, profile_digest(&ProfileInput { gains: Some(vec![1.0, 1.1]), ..input() }));
        assert_ne!(base, profile_digest(&ProfileInput { image_width: 641, ..input() }));
        let mut moved = input();
        moved.homographies[1].0[2] = 0.500_000_1;
        assert_ne!(base, profile_digest(&moved));
        let [red, blue] = [0.001, -0.001].map(|scale| ColourDisplacement { scale, shift_px: [0.0; 2] });
        let of =
            |red, blue| profile_digest(&ProfileInput { lateral_colour: Some(LateralColour { red, blue }), ..input() });
        assert_ne!(base, of(red, blue));
        assert_ne!(of(blue, red), of(red, blue));
    }

    #[test]
    fn the_optics_digest_depends_on_every_camera_parameter_and_not_on_the_geometry() {
        let base = optics_digest(&input());
        let mut moved = input();
        moved.homographies[1].0[2] = 0.75;
        assert_eq!(base, optics_digest(&ProfileInput { note: Some("of Tuesday".into()), ..moved }));
        let changed = [
            ProfileInput { principal_distance_mm: Some(130.0), ..input() },
            ProfileInput { pixel_pitch_mm: Some(0.004), ..input() },
            ProfileInput { magnification: Some(0.004), ..input() },
            ProfileInput { principal_point_px: Some([320.0, 240.0]), ..input() },
            ProfileInput { rail_positions_mm: Some(vec![320.0, 240.0]), ..input() },
            ProfileInput { capture_mode: Some(CaptureMode::FixedLens), ..input() },
            ProfileInput { capture_mode: Some(CaptureMode::MovingLens), ..input() },
            ProfileInput { capture_mode: Some(CaptureMode::LensAlone), ..input() },
            ProfileInput { principal_distance_source: Some(PrincipalDistanceSource::CameraRail), ..input() },
            ProfileInput { principal_distance_source: Some(PrincipalDistanceSource::Unknown), ..input() },
            ProfileInput { pupils: Pupils { pupil_ratio: Some(1.5), ..Pupils::default() }, ..input() },
            ProfileInput { pupils: Pupils { exit_pupil_distance_mm: Some(1.5), ..Pupils::default() }, ..input() },
        ];
        let mut digests: Vec<String> = changed.iter().map(optics_digest).collect();
        digests.push(base);
        for changed in &changed {
            assert_eq!(profile_digest(changed), profile_digest(&input()), "the pixels are the same");
        }
        digests.sort();
        digests.dedup();
        assert_eq!(digests.len(), changed.len() + 1);
    }
}
