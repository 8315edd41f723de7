//! What the headers of the slices tell: the layout, and warnings about one light.

use std::io;

use super::*;

/// A TIFF of 600 x 400 px in colour with 16 bits, whose directory is in its second megabyte.
fn deep_late_tiff() -> Vec<u8> {
    let mut out = io::Cursor::new(Vec::new());
    let mut encoder = ::tiff::encoder::TiffEncoder::new(&mut out).unwrap();
    let samples: Vec<u16> = (0..600 * 400 * 3_u64).map(|i| (i * 7919 % 65_521) as u16).collect();
    encoder.write_image::<::tiff::encoder::colortype::RGB16>(600, 400, &samples).unwrap();
    out.into_inner()
}

#[test]
fn a_light_whose_headers_are_far_back_counts_for_the_layout_too() {
    let tiff = |name: &str| deflated(entry(name, &deep_late_tiff()), 8);
    let jpeg = |name: &str| entry(name, &codec::encode_jpeg(&sized(600, 400, 1), 90));
    for [far, near] in [["front", "back"], ["back", "front"]] {
        let names = [1, 2].map(|i| (format!("{far}/{i}.tif"), format!("{near}/{i}.jpg")));
        let entries: Vec<Entry> = names.iter().flat_map(|(a, b)| [tiff(a), jpeg(b)]).collect();
        let bytes = Arc::new(zip(&entries));
        for archive in [open_near(bytes.clone(), &ArchiveLimits::default()), open_bytes(&bytes)] {
            let archive = archive.unwrap();
            let layout = archive.layout();
            let found = (layout.width, layout.height, layout.bit_depth, layout.channels);
            assert_eq!(found, (600, 400, 16, 3), "{far}");
        }
    }
}

#[test]
fn a_warning_of_mixed_slices_names_the_light_and_two_slices() {
    let warnings = |other: &Raster| {
        let mut entries = pictures(&["front/a.png", "front/b.png", "back/a.png", "back/b.png"]);
        entries[3].data = png_of(other, &Metadata::default());
        open_bytes(&zip(&entries)).unwrap().warnings().to_vec()
    };
    let found = warnings(&Raster::sixteen(20, 16, 1, vec![9; 320]));
    assert_eq!((found.len(), found[0].code.as_str()), (1, "mixed_bit_depth"));
    let expected = "the back-light slices differ in bit depth: back/a.png has 8 bits per sample, back/b.png has 16 \
                    bits per sample; use the same settings for all slices of one light";
    assert_eq!(found[0].detail, expected);
    let found = warnings(&Raster::eight(20, 16, 3, vec![9; 960]));
    assert_eq!((found.len(), found[0].code.as_str()), (1, "mixed_colour"));
    assert!(found[0].detail.contains("back/a.png is grey, back/b.png is in colour"), "{}", found[0].detail);
}

#[test]
fn a_warning_of_the_order_says_what_gave_the_order() {
    let mut entries: Vec<Entry> =
        [1, 2, 4, 3, 5].iter().enumerate().map(|(i, &s)| entry(&format!("s{i}.png"), &taken_at(s))).collect();
    let advice = |entries: &[Entry]| {
        let found = open_bytes(&zip(entries)).unwrap().warnings().to_vec();
        assert_eq!((found.len(), found[0].code.as_str()), (1, "order_contradicts_times"));
        assert!(found[0].detail.contains("in the order in which they are used"), "{}", found[0].detail);
        found[0].detail.rsplit_once("; ").unwrap().1.to_owned()
    };
    assert_eq!(advice(&entries), "if the names are wrong, rename the files or list them in manifest.json");
    let listed = br#"{"front": ["s0.png", "s1.png", "s2.png", "s3.png", "s4.png"]}"#;
    entries.push(entry("manifest.json", listed));
    assert_eq!(advice(&entries), "if the order is wrong, correct manifest.json");
}

#[test]
fn one_odd_slice_is_told_in_the_singular() {
    let mut entries = pictures(&["a.png", "b.png", "c.png", "d.png", "e.png"]);
    entries[1].data = png_of(&sized(16, 20, 1), &Metadata::default());
    assert!(refused(&entries).detail.starts_with("1 of 5 slices is not 20 x 16 px"), "{}", refused(&entries).detail);
    entries[2].data = entries[1].data.clone();
    assert!(refused(&entries).detail.starts_with("2 of 5 slices are not 20 x 16 px"), "{}", refused(&entries).detail);
}
