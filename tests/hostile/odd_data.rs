//! Unusual codings of samples, and damaged ones: they are decoded as other programs do, or refused with their reason.

use std::io::Cursor;

use pinstack_science::imaging::{
    Raster, Samples,
    codec::{self, ColourSpace, Limits, Metadata},
};

use crate::{
    odd_files::{Page, jpeg, longs, lzw, shorts, tiff},
    odd_pictures::{
        HEIGHT,
        Outcome::{Pixels, Refused},
        WIDTH, check, picture, plain, png, rgb, sample,
    },
};

/// The value of a pixel at `x` and `y`, per channel.
type Content<'a> = &'a dyn Fn(usize, usize, usize) -> u8;

#[test]
fn lzw_tiles_that_extend_beyond_the_picture_are_read() {
    let noise = |i: usize| (i.wrapping_mul(2_654_435_761) >> 13) as u8;
    let contents: [(&str, Content<'_>); 3] = [
        ("soft", &sample),
        ("one colour", &|_, _, _| 200),
        ("noise", &|x, y, channel| noise(x * 7_919 + y * 104_729 + channel * 31)),
    ];
    for (width, height) in [(70, 50), (65, 33)] {
        for (content, value) in contents {
            for (side, bytes, predicts) in
                [(16, 1, false), (64, 1, true), (64, 2, false), (128, 1, false), (128, 2, true)]
            {
                let tile = |left: usize, top: usize| {
                    let at = |y: usize, x: usize, c: usize| {
                        let inside = left + x < width && top + y < height;
                        if inside { value(left + x, top + y, c) } else { 0 }
                    };
                    let difference = |y: usize, x: usize, c: usize| {
                        let before = if predicts && x > 0 { at(y, x - 1, c) } else { 0 };
                        (u16::from(at(y, x, c)) * 257).wrapping_sub(u16::from(before) * 257)
                    };
                    let samples = (0..side * side * 3).map(|i| difference(i / 3 / side, i / 3 % side, i % 3));
                    let stored: Vec<u8> = match bytes {
                        1 => samples.map(|v| v as u8).collect(),
                        _ => samples.flat_map(u16::to_le_bytes).collect(),
                    };
                    lzw(&stored)
                };
                let rows = (0..height).step_by(side);
                let stored = rows.flat_map(|top| (0..width).step_by(side).map(move |left| (left, top)));
                let stored = stored.map(|(left, top)| tile(left, top)).collect();
                let predictor = shorts(317, &[if predicts { 2 } else { 1 }]);
                let tags = vec![shorts(259, &[5]), longs(322, &[side as u32]), longs(323, &[side as u32]), predictor];
                let (w, h, bits) = (width as u32, height as u32, 8 * bytes);
                let file = tiff(&[Page { width: w, height: h, channels: 3, bits, stored, tags }]);
                let eight: Vec<u8> =
                    (0..width * height * 3).map(|i| value(i / 3 % width, i / 3 / width, i % 3)).collect();
                let expected = match bytes {
                    1 => Raster::eight(width, height, 3, eight),
                    _ => Raster::sixteen(width, height, 3, eight.iter().map(|&v| u16::from(v) * 257).collect()),
                };
                let what = format!("{width} x {height}, {content}, tiles of {side}, {bits} bits");
                check(vec![(what.as_str(), file.clone(), Pixels(expected, ColourSpace::Srgb))]);
            }
        }
    }
}

#[test]
fn the_sampling_of_a_jpeg_gives_its_colours_or_is_refused() {
    let colours = [[120, 90, 170], [60, 160, 100], [200, 128, 120], [90, 110, 140]];
    let right: [[[u8; 2]; 3]; 12] = [
        [[1, 1], [1, 1], [1, 1]],
        [[2, 1], [1, 1], [1, 1]],
        [[1, 2], [1, 1], [1, 1]],
        [[2, 2], [1, 1], [1, 1]],
        [[4, 1], [1, 1], [1, 1]],
        [[4, 2], [1, 1], [1, 1]],
        [[2, 2], [2, 1], [1, 2]],
        [[2, 2], [2, 2], [1, 1]],
        [[2, 1], [2, 1], [2, 1]],
        [[1, 1], [1, 2], [1, 2]],
        [[2, 1], [1, 2], [1, 2]],
        [[1, 1], [1, 2], [1, 1]],
    ];
    let wrong: [[[u8; 2]; 3]; 11] = [
        [[1, 1], [2, 1], [2, 1]],
        [[1, 1], [2, 2], [2, 2]],
        [[1, 1], [2, 1], [1, 1]],
        [[1, 1], [1, 1], [2, 1]],
        [[1, 2], [2, 1], [2, 1]],
        [[2, 2], [4, 1], [1, 1]],
        [[2, 1], [4, 1], [1, 1]],
        [[3, 1], [1, 1], [1, 1]],
        [[4, 1], [1, 2], [1, 2]],
        [[1, 1], [1, 2], [1, 4]],
        [[2, 1], [0, 1], [1, 1]],
    ];
    for sampling in right {
        let decoded = codec::decode(&jpeg(&sampling, &colours), &Limits::default());
        let decoded = decoded.unwrap_or_else(|fault| panic!("{sampling:?}: {fault}"));
        let Samples::Eight(samples) = &decoded.samples else { panic!("a JPEG has 8 bits") };
        let across = decoded.width / colours.len();
        for (at, [y, cb, cr]) in colours.map(|colour| colour.map(f64::from)).into_iter().enumerate() {
            // the middle, away from the interpolation of the colours
            let (x, row) = (at * across + across / 2, decoded.height / 2);
            let expected =
                [y + 1.402 * (cr - 128.0), y - 0.344 * (cb - 128.0) - 0.714 * (cr - 128.0), y + 1.772 * (cb - 128.0)];
            for (channel, expected) in expected.into_iter().enumerate() {
                let found = f64::from(samples[(row * decoded.width + x) * 3 + channel]);
                assert!(
                    (found - expected).abs() < 3.0,
                    "{sampling:?}, MCU {at}, channel {channel}: {found}, not {expected}"
                );
            }
        }
    }
    let refused =
        wrong.map(|sampling| ("finer colour", jpeg(&sampling, &colours), Refused("finer than its brightness")));
    check(refused.into());
    check(vec![("grey in steps of three", jpeg(&[[3, 1]], &colours), Refused("unusual steps"))]);
}

#[test]
fn reversed_bits_and_damaged_data_of_a_tiff_are_named() {
    let reversed = |bits: u16| Page {
        bits,
        stored: vec![rgb(WIDTH, HEIGHT).iter().flat_map(|v| vec![v.reverse_bits(); usize::from(bits / 8)]).collect()],
        ..plain(&[shorts(266, &[2])])
    };
    let mut damaged = Cursor::new(Vec::new());
    codec::encode_tiff(&mut damaged, &picture(), &Metadata::default()).expect("a TIFF");
    let mut damaged = damaged.into_inner();
    damaged[8 + 40..8 + 70].fill(0xFF);
    check(vec![
        ("8 bits", tiff(&[reversed(8)]), Refused("FillOrder 2")),
        ("16 bits", tiff(&[reversed(16)]), Refused("FillOrder 2")),
        ("the usual order", tiff(&[plain(&[shorts(266, &[1])])]), Pixels(picture(), ColourSpace::Srgb)),
        ("damaged deflate data", damaged, Refused("the TIFF is damaged (its compressed data are not valid)")),
    ]);
}

#[test]
fn the_sentence_about_a_damaged_png_has_no_words_of_a_library() {
    let whole = png(&picture(), None);
    let chunk_at = |kind: &[u8]| whole.windows(4).position(|four| four == kind).expect("a chunk");
    let wrong_sum = |kind: &[u8]| {
        let at = chunk_at(kind);
        let length = u32::from_be_bytes(*whole[at - 4..].first_chunk().expect("a length")) as usize;
        let mut out = whole.clone();
        out[at + 4 + length] ^= 0x55;
        out
    };
    let mut renamed = whole.clone();
    renamed[chunk_at(b"IDAT") + 2] = 1;
    let without_pixels = [&whole[..chunk_at(b"IDAT") - 4], &whole[chunk_at(b"IEND") - 4..]].concat();
    check(vec![
        (
            "checksum of the pixels",
            wrong_sum(b"IDAT"),
            Refused("the PNG is damaged (a checksum is wrong); copy it again"),
        ),
        (
            "checksum of the header",
            wrong_sum(b"IHDR"),
            Refused("the PNG is damaged (a checksum is wrong); copy it again"),
        ),
        ("a kind of chunk that no PNG has", renamed, Refused("the PNG is damaged (")),
        ("no pixels", without_pixels, Refused("the PNG ")),
    ]);
}
