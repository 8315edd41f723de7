//! The digest of a profile: what results name, so that anyone can tell which numbers made them.

use sha2::{Digest, Sha256};

use crate::model::profile::ProfileInput;

/// SHA-256 (hex) of what defines the geometry and the gains of a profile: image size, reference slice, and for each
/// slice the nine numbers of its homography and its gain (1 where none is given). Note, rail positions and where the
/// numbers come from do not enter: two profiles with one digest give the same picture.
pub fn profile_digest(input: &ProfileInput) -> String {
    let mut hash = Sha256::new();
    hash.update(b"pinstack profile 1\0");
    for number in [input.image_width, input.image_height, input.reference_index] {
        hash.update(number.to_le_bytes());
    }
    for (index, homography) in input.homographies.iter().enumerate() {
        let gain = input.gain(index);
        for number in homography.0.into_iter().chain([gain]) {
            // adding zero turns -0.0 into 0.0: they are the same number
            hash.update((number + 0.0).to_le_bytes());
        }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Homography;

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
    fn the_digest_changes_with_the_numbers_and_not_with_the_note() {
        let base = profile_digest(&input());
        assert_eq!(base.len(), 64);
        assert_eq!(base, profile_digest(&ProfileInput { note: Some("of Tuesday".into()), ..input() }));
        assert_eq!(base, profile_digest(&ProfileInput { gains: Some(vec![1.0, 1.0]), ..input() }));
        assert_ne!(base, profile_digest(&ProfileInput { gains: Some(vec![1.0, 1.1]), ..input() }));
        assert_ne!(base, profile_digest(&ProfileInput { image_width: 641, ..input() }));
        let mut moved = input();
        moved.homographies[1].0[2] = 0.500_000_1;
        assert_ne!(base, profile_digest(&moved));
    }
}
