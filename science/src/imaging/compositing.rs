//! The output image: fused colours and an alpha mask become an RGBA raster of the wanted bit depth.
//!
//! Conversions between depths map full scale to full scale: 8 bits become 16 by `v * 257`, 16 bits become 8 by rounding
//! `v / 257` to nearest. So 8 bits survive the way through 16 unchanged.

use super::{Depth, Plane, Raster, Rect, Samples};

/// The RGBA raster of `rect`: the colours of `image` (grey is copied to R, G and B) with straight alpha (255 is
/// opaque).
///
/// `image` and `alpha` cover the whole canvas. Where alpha is 0 the colour is black, unless `keep_hidden_colour` is
/// set: most feature extractors ignore alpha and would see the background.
///
/// # Panics
/// When `rect` is not inside the canvas.
pub fn rgba(image: &Raster, alpha: &Plane<u8>, rect: Rect, depth: Depth, keep_hidden_colour: bool) -> Raster {
    let (width, height, keep) = (rect.width, rect.height, keep_hidden_colour);
    match (&image.samples, depth) {
        (Samples::Eight(s), Depth::Eight) => {
            Raster::eight(width, height, 4, pixels(image, s, alpha, rect, keep, |v| v, |a| a))
        }
        (Samples::Eight(s), Depth::Sixteen) => {
            Raster::sixteen(width, height, 4, pixels(image, s, alpha, rect, keep, to_sixteen, to_sixteen))
        }
        (Samples::Sixteen(s), Depth::Sixteen) => {
            Raster::sixteen(width, height, 4, pixels(image, s, alpha, rect, keep, |v| v, to_sixteen))
        }
        (Samples::Sixteen(s), Depth::Eight) => {
            Raster::eight(width, height, 4, pixels(image, s, alpha, rect, keep, to_eight, |a| a))
        }
    }
}

/// `alpha` where `valid` is 255, and 0 where it is 0. Both planes have the same size.
pub fn masked(alpha: &Plane<u8>, valid: &Plane<u8>) -> Plane<u8> {
    let data = valid.data.iter().zip(&alpha.data).map(|(&v, &a)| v & a).collect();
    Plane { width: valid.width, height: valid.height, data }
}

fn to_sixteen(value: u8) -> u16 {
    u16::from(value) * 257
}

fn to_eight(value: u16) -> u8 {
    // (65535 + 128) / 257 is 255, so the cast is lossless
    ((u32::from(value) + 128) / 257) as u8
}

fn pixels<S: Copy, T: Copy + Default>(
    image: &Raster,
    samples: &[S],
    alpha: &Plane<u8>,
    rect: Rect,
    keep_hidden_colour: bool,
    colour: impl Fn(S) -> T,
    opacity: impl Fn(u8) -> T,
) -> Vec<T> {
    let step = image.channels;
    let mut out = Vec::with_capacity(rect.width * rect.height * 4);
    for y in rect.y..rect.y + rect.height {
        let row = &samples[(y * image.width + rect.x) * step..][..rect.width * step];
        let alphas = &alpha.row(y)[rect.x..rect.x + rect.width];
        for (pixel, &alpha) in row.chunks_exact(step).zip(alphas) {
            if alpha == 0 && !keep_hidden_colour {
                out.extend([T::default(); 4]);
                continue;
            }
            let [r, g, b] = if step == 1 { [pixel[0]; 3] } else { [pixel[0], pixel[1], pixel[2]] };
            out.extend([colour(r), colour(g), colour(b), opacity(alpha)]);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn eight(raster: &Raster) -> &[u8] {
        match &raster.samples {
            Samples::Eight(samples) => samples,
            Samples::Sixteen(_) => panic!("not 8 bits"),
        }
    }

    #[test]
    fn a_pixel_outside_the_object_is_transparent_and_black_unless_its_colour_is_kept() {
        let image = Raster::eight(2, 1, 3, vec![1, 2, 3, 4, 5, 6]);
        let alpha = Plane { width: 2, height: 1, data: vec![255, 0] };
        let whole = Rect::whole(2, 1);
        assert_eq!(eight(&rgba(&image, &alpha, whole, Depth::Eight, false)), [1, 2, 3, 255, 0, 0, 0, 0]);
        assert_eq!(eight(&rgba(&image, &alpha, whole, Depth::Eight, true)), [1, 2, 3, 255, 4, 5, 6, 0]);
    }

    #[test]
    fn sixteen_bits_round_to_eight_and_eight_survive_sixteen() {
        let alpha = Plane::filled(3, 1, 255u8);
        let deep = Raster::sixteen(3, 1, 1, vec![0, 65_535, 385]);
        let narrow = rgba(&deep, &alpha, Rect::whole(3, 1), Depth::Eight, true);
        assert_eq!(eight(&narrow), [0, 0, 0, 255, 255, 255, 255, 255, 1, 1, 1, 255]);
        let all = Raster::eight(256, 1, 1, (0..=255).collect());
        let opaque = Plane::filled(256, 1, 255u8);
        let whole = Rect::whole(256, 1);
        let wide = rgba(&all, &opaque, whole, Depth::Sixteen, true);
        let back = rgba(&Raster { channels: 4, ..wide }, &opaque, whole, Depth::Eight, true);
        assert_eq!(back, rgba(&all, &opaque, whole, Depth::Eight, true));
    }

    #[test]
    fn a_crop_takes_the_same_pixels_of_image_alpha_and_colours() {
        let rect = Rect { x: 1, y: 1, width: 2, height: 1 };
        let plane = Plane::from_fn(4, 3, |x, y| (10 * y + x) as u8);
        let image = Raster::eight(4, 3, 1, plane.data.clone());
        let colour = rgba(&image, &Plane::filled(4, 3, 255), rect, Depth::Eight, false);
        assert_eq!(eight(&colour), [11, 11, 11, 255, 12, 12, 12, 255]);
    }

    #[test]
    fn a_mask_clears_alpha_outside_of_the_valid_pixels() {
        let plane = |data: [u8; 3]| Plane { width: 3, height: 1, data: data.to_vec() };
        assert_eq!(masked(&plane([200, 200, 0]), &plane([255, 0, 255])), plane([200, 0, 0]));
    }
}
