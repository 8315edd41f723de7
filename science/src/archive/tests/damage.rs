//! Whatever bytes come, they are an answer.

use super::*;

/// Opens and loads everything; whatever it is, it is an answer.
fn exercise(bytes: &[u8]) {
    let limits = ArchiveLimits {
        max_member_bytes: 1 << 20,
        max_total_bytes: 4 << 20,
        image: codec::Limits { max_pixels: 1 << 18, ..codec::Limits::default() },
        ..ArchiveLimits::default()
    };
    if let Ok(archive) = open_within(bytes, &limits) {
        for slices in [archive.front(), archive.back()] {
            for index in 0..slices.count() {
                let _ = slices.load(index);
            }
        }
    }
}

fn sound() -> Vec<u8> {
    let mut entries = pictures(&["w/front/a.png", "w/front/b.png", "w/back/a.png", "w/back/b.png"]);
    entries[1] = deflated(entries[1].clone(), 8);
    entries[2] = deflated(entries[2].clone(), 9);
    entries.push(entry("w/manifest.json", br#"{"front": ["a.png", "b.png"], "back": ["a.png", "b.png"]}"#));
    zip(&entries)
}

proptest::proptest! {
    #![proptest_config(proptest::prelude::ProptestConfig::with_cases(300))]

    #[test]
    fn damaged_zips_never_panic(flips in proptest::collection::vec((0..100_000usize, 1..=255u8), 1..6), cut in 0..4000usize) {
        let mut bytes = sound();
        for (at, flip) in flips {
            let at = at % bytes.len();
            bytes[at] ^= flip;
        }
        if cut < 1000 {
            bytes.truncate(bytes.len() * cut / 1000);
        }
        exercise(&bytes);
    }

    #[test]
    fn damage_to_the_directory_never_panics(flips in proptest::collection::vec((0..600usize, 1..=255u8), 1..8)) {
        let mut bytes = sound();
        let length = bytes.len();
        for (back, flip) in flips {
            bytes[length - 1 - back % length] ^= flip;
        }
        exercise(&bytes);
    }

    #[test]
    fn random_bytes_never_panic(mut bytes in proptest::collection::vec(proptest::num::u8::ANY, 0..400), tail: bool) {
        if tail {
            bytes.extend(b"PK\x05\x06\0\0\0\0\x02\0\x02\0");
            bytes.extend([40, 0, 0, 0, 1, 0, 0, 0, 0, 0]);
        }
        exercise(&bytes);
    }
}

#[test]
fn every_cut_of_a_sound_zip_is_refused() {
    let bytes = sound();
    assert!(open_bytes(&bytes).is_ok());
    for cut in 0..bytes.len() {
        assert!(open_bytes(&bytes[..cut]).is_err(), "{cut} of {}", bytes.len());
    }
}
