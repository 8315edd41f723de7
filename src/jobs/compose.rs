//! From the fused picture to the one that comes out: crop, bit depth, straight alpha.

use crate::contract::{
    Code, Fault,
    options::{BitDepth, Crop, ImageFormat, UnderAlpha},
};
use pinstack_science::{
    fusion::crop::valid_rect,
    imaging::{Depth, Plane, Raster, Rect, Samples},
    types::profile::ProfileInput,
};

/// The part of the canvas that comes out.
///
/// # Errors
/// A rectangle that leaves the canvas, or `valid` when the slices of the profile have no pixel in common.
pub fn crop_rect(crop: Crop, profile: &ProfileInput) -> Result<Rect, Fault> {
    let (columns, rows) = (profile.image_width, profile.image_height);
    match crop {
        Crop::None => Ok(Rect::whole(columns as usize, rows as usize)),
        Crop::Valid => valid_rect(&profile.homographies, columns, rows).ok_or_else(|| {
            let detail = "crop=valid leaves nothing: the slices of this profile have no pixel in common";
            Fault::new(Code::InvalidProfile, detail)
        }),
        Crop::Rect { x, y, width, height } => {
            let inside = |start: u32, length: u32, all: u32| {
                length > 0 && start.checked_add(length).is_some_and(|end| end <= all)
            };
            if !inside(x, width, columns) || !inside(y, height, rows) {
                let detail = format!("crop={x},{y},{width},{height} leaves the canvas of {columns} x {rows} px");
                return Err(Fault::new(Code::InvalidRequest, detail));
            }
            let [x, y, width, height] = [x, y, width, height].map(|v| v as usize);
            Ok(Rect { x, y, width, height })
        }
    }
}

/// The depth that was asked for, for slices of depth `slices`.
pub fn depth(asked: BitDepth, format: ImageFormat, slices: Depth) -> Depth {
    match asked {
        BitDepth::Auto if format == ImageFormat::Jpeg => Depth::Eight,
        BitDepth::Auto => slices,
        BitDepth::Eight => Depth::Eight,
        BitDepth::Sixteen => Depth::Sixteen,
    }
}

/// The RGBA picture of `rect`: colour of `image` (grey is spread to RGB), straight alpha from `alpha` (255 is opaque).
/// 8 bits become 16 by `v * 257`, 16 become 8 by rounding. Both planes are of the size of the canvas.
pub fn rgba(image: &Raster, alpha: &Plane<u8>, rect: Rect, depth: Depth, under: UnderAlpha) -> Raster {
    let (width, height) = (rect.width, rect.height);
    match (&image.samples, depth) {
        (Samples::Eight(s), Depth::Eight) => {
            Raster::eight(width, height, 4, pixels(image, s, alpha, rect, under, |v| v, |a| a))
        }
        (Samples::Eight(s), Depth::Sixteen) => {
            Raster::sixteen(width, height, 4, pixels(image, s, alpha, rect, under, wide, wide))
        }
        (Samples::Sixteen(s), Depth::Sixteen) => {
            Raster::sixteen(width, height, 4, pixels(image, s, alpha, rect, under, |v| v, wide))
        }
        (Samples::Sixteen(s), Depth::Eight) => {
            Raster::eight(width, height, 4, pixels(image, s, alpha, rect, under, narrowed, |a| a))
        }
    }
}

/// 8 bits to 16, full scale to full scale.
fn wide(value: u8) -> u16 {
    u16::from(value) * 257
}

/// 16 bits to the nearest of 8.
fn narrowed(value: u16) -> u8 {
    // (65535 + 128) / 257 is 255, so nothing is cut off
    ((u32::from(value) + 128) / 257) as u8
}

fn pixels<S: Copy, T: Copy + Default>(
    image: &Raster,
    samples: &[S],
    alpha: &Plane<u8>,
    rect: Rect,
    under: UnderAlpha,
    convert: impl Fn(S) -> T,
    opacity: impl Fn(u8) -> T,
) -> Vec<T> {
    let step = image.channels;
    let mut out = Vec::with_capacity(rect.width * rect.height * 4);
    for y in rect.y..rect.y + rect.height {
        let row = &samples[(y * image.width + rect.x) * step..][..rect.width * step];
        let alphas = &alpha.row(y)[rect.x..rect.x + rect.width];
        for (pixel, &covered) in row.chunks_exact(step).zip(alphas) {
            if covered == 0 && under == UnderAlpha::Black {
                out.extend([T::default(); 4]);
                continue;
            }
            let [r, g, b] = if step == 1 { [pixel[0]; 3] } else { [pixel[0], pixel[1], pixel[2]] };
            out.extend([convert(r), convert(g), convert(b), opacity(covered)]);
        }
    }
    out
}

/// A part of a raster.
pub fn cropped(image: &Raster, rect: Rect) -> Raster {
    fn part<S: Copy>(image: &Raster, samples: &[S], rect: Rect) -> Vec<S> {
        let step = image.channels;
        let mut out = Vec::with_capacity(rect.width * rect.height * step);
        for y in rect.y..rect.y + rect.height {
            out.extend_from_slice(&samples[(y * image.width + rect.x) * step..][..rect.width * step]);
        }
        out
    }
    match &image.samples {
        Samples::Eight(s) => Raster::eight(rect.width, rect.height, image.channels, part(image, s, rect)),
        Samples::Sixteen(s) => Raster::sixteen(rect.width, rect.height, image.channels, part(image, s, rect)),
    }
}

/// A part of a plane, as the samples of a grey raster.
pub fn cropped_plane<S: Copy>(plane: &Plane<S>, rect: Rect) -> Vec<S> {
    let rows = rect.y..rect.y + rect.height;
    rows.flat_map(|y| plane.row(y)[rect.x..rect.x + rect.width].iter().copied()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use pinstack_science::types::Homography;

    fn profile(homographies: Vec<Homography>) -> ProfileInput {
        ProfileInput {
            image_width: 60,
            image_height: 40,
            reference_index: 0,
            homographies,
            gains: None,
            ..ProfileInput::default()
        }
    }

    fn eight(raster: &Raster) -> &[u8] {
        match &raster.samples {
            Samples::Eight(samples) => samples,
            Samples::Sixteen(_) => panic!("8 bits were asked for"),
        }
    }

    #[test]
    fn the_crop_is_the_canvas_the_common_part_or_the_rectangle() {
        let shifted = profile(vec![Homography::IDENTITY, Homography::similarity(1.0, [3.0, 0.0])]);
        assert_eq!(crop_rect(Crop::None, &shifted), Ok(Rect::whole(60, 40)));
        assert_eq!(crop_rect(Crop::Valid, &shifted), Ok(Rect { x: 3, y: 0, width: 57, height: 40 }));
        let given = Crop::Rect { x: 10, y: 20, width: 50, height: 20 };
        assert_eq!(crop_rect(given, &shifted), Ok(Rect { x: 10, y: 20, width: 50, height: 20 }));
    }

    #[test]
    fn a_crop_that_leaves_the_canvas_or_nothing_is_refused() {
        let aligned = profile(vec![Homography::IDENTITY; 2]);
        for (x, width) in [(11, 50), (60, 1), (u32::MAX, 2), (0, 61)] {
            let crop = Crop::Rect { x, y: 0, width, height: 1 };
            assert_eq!(crop_rect(crop, &aligned).map_err(|f| f.code), Err(Code::InvalidRequest), "{x} {width}");
        }
        let apart = profile(vec![Homography::similarity(1.0, [40.0, 0.0]), Homography::similarity(1.0, [-40.0, 0.0])]);
        assert_eq!(crop_rect(Crop::Valid, &apart).map_err(|f| f.code), Err(Code::InvalidProfile));
    }

    #[test]
    fn a_pixel_outside_the_object_is_transparent_and_black_unless_kept() {
        let image = Raster::eight(2, 1, 3, vec![1, 2, 3, 4, 5, 6]);
        let alpha = Plane { width: 2, height: 1, data: vec![255, 0] };
        let whole = Rect::whole(2, 1);
        let black = rgba(&image, &alpha, whole, Depth::Eight, UnderAlpha::Black);
        assert_eq!(eight(&black), [1, 2, 3, 255, 0, 0, 0, 0]);
        let kept = rgba(&image, &alpha, whole, Depth::Eight, UnderAlpha::Keep);
        assert_eq!(eight(&kept), [1, 2, 3, 255, 4, 5, 6, 0]);
    }

    #[test]
    fn sixteen_bits_round_to_eight_and_eight_come_back_from_sixteen() {
        let alpha = Plane::filled(3, 1, 255u8);
        let deep = Raster::sixteen(3, 1, 1, vec![0, 65_535, 385]);
        let narrow = rgba(&deep, &alpha, Rect::whole(3, 1), Depth::Eight, UnderAlpha::Keep);
        assert_eq!(eight(&narrow), [0, 0, 0, 255, 255, 255, 255, 255, 1, 1, 1, 255]);
        let all = Raster::eight(256, 1, 1, (0..=255).collect());
        let opaque = Plane::filled(256, 1, 255u8);
        let whole = Rect::whole(256, 1);
        let wide = rgba(&all, &opaque, whole, Depth::Sixteen, UnderAlpha::Keep);
        let back = rgba(&Raster { channels: 4, ..wide }, &opaque, whole, Depth::Eight, UnderAlpha::Keep);
        assert_eq!(back, rgba(&all, &opaque, whole, Depth::Eight, UnderAlpha::Keep));
    }

    #[test]
    fn a_crop_takes_the_same_pixels_of_pictures_planes_and_colours() {
        let rect = Rect { x: 1, y: 1, width: 2, height: 1 };
        let plane = Plane::from_fn(4, 3, |x, y| (10 * y + x) as u8);
        let image = Raster::eight(4, 3, 1, plane.data.clone());
        assert_eq!(cropped_plane(&plane, rect), [11, 12]);
        assert_eq!(eight(&cropped(&image, rect)), [11, 12]);
        let colour = rgba(&image, &Plane::filled(4, 3, 255), rect, Depth::Eight, UnderAlpha::Black);
        assert_eq!(eight(&colour), [11, 11, 11, 255, 12, 12, 12, 255]);
    }
}
