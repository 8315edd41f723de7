use super::*;

/// `#` object (dark), `.` background (bright), `?` not valid (and dark).
fn scene(rows: &[&str]) -> (Raster, Plane<u8>) {
    let (width, height) = (rows[0].len(), rows.len());
    let at = |x: usize, y: usize| rows[y].as_bytes()[x];
    let grey = Plane::from_fn(width, height, |x, y| if at(x, y) == b'.' { 220u8 } else { 25 });
    let valid = Plane::from_fn(width, height, |x, y| if at(x, y) == b'?' { 0u8 } else { 255 });
    (Raster::eight(width, height, 1, grey.data), valid)
}

fn params(min_blob_px: u32, min_hole_px: u32) -> MaskParams {
    MaskParams { threshold: MaskThreshold::Auto, min_blob_px, min_hole_px, edge: MaskEdge::Hard }
}

fn drawn(mask: &Plane<u8>) -> Vec<String> {
    let letter = |&v: &u8| if v == 255 { '#' } else { '.' };
    (0..mask.height).map(|y| mask.row(y).iter().map(letter).collect()).collect()
}

fn codes(silhouette: &Silhouette) -> Vec<&str> {
    silhouette.warnings.iter().map(|warning| warning.code.as_str()).collect()
}

#[test]
fn the_dark_object_is_segmented_small_parts_are_removed_and_small_holes_filled() {
    let (light, valid) = scene(&[
        "............",
        ".#######..#.",
        ".#.####.....",
        ".####..#....",
        ".####..#..#.",
        ".#######.#..",
        "............",
    ]);
    let result = segment(&light, &valid, &params(3, 4));
    assert_eq!(
        drawn(&result.mask),
        [
            "............",
            ".#######....",
            ".######.....",
            ".####..#....",
            ".####..#....",
            ".#######....",
            "............",
        ]
    );
    // background connected over corners is not one hole: the notch at the right is closed
    assert_eq!((result.metrics.components, result.metrics.holes), (1, 1));
    assert_eq!(codes(&result), [] as [&str; 0]);
    assert!((result.metrics.threshold - (220.0 + 25.0) / 2.0 / 255.0).abs() < 0.01);
    assert!(result.metrics.separability.unwrap() > 0.999);
    assert_eq!(result.metrics.border_contact_fraction, 0.0);
    let object = result.mask.data.iter().filter(|&&v| v == 255).count();
    assert!((result.metrics.foreground_fraction - object as f64 / 84.0).abs() < 1e-12);
}

#[test]
fn a_diagonal_hair_is_one_part() {
    let (light, valid) = scene(&["........", ".#......", "..#.....", "...#....", "....#...", "........"]);
    assert_eq!(segment(&light, &valid, &params(4, 4)).metrics.components, 1);
    let removed = segment(&light, &valid, &params(5, 4));
    assert_eq!(codes(&removed), ["mask_empty"]);
    assert!(removed.warnings[0].detail.contains("mask_min_blob_px (5 px)"), "{:?}", removed.warnings);
}

#[test]
fn an_island_in_a_filled_hole_is_no_part_of_its_own() {
    let (light, valid) = scene(&[
        ".........",
        ".#######.",
        ".#.....#.",
        ".#.###.#.",
        ".#.###.#.",
        ".#.###.#.",
        ".#.....#.",
        ".#######.",
        ".........",
    ]);
    let parts_and_holes = |min_hole_px: u32| {
        let metrics = segment(&light, &valid, &params(4, min_hole_px)).metrics;
        (metrics.components, metrics.holes)
    };
    assert_eq!((parts_and_holes(4), parts_and_holes(17)), ((2, 1), (1, 0)));
}

#[test]
fn background_that_reaches_the_border_or_invalid_pixels_is_no_hole() {
    let (light, valid) = scene(&["..####..", "..#.??..", "..####..", "#.######", "..#.####", "#.######"]);
    let result = segment(&light, &valid, &params(1, 4));
    assert_eq!(drawn(&result.mask), ["..####..", "..#.....", "..####..", "#.######", "..######", "#.######"]);
    assert_eq!(result.metrics.holes, 0);
    assert_eq!(result.metrics.components, 3);
}

#[test]
fn invalid_pixels_are_background_and_do_not_move_the_threshold() {
    let (light, valid) = scene(&["????....", "????.##.", "????.##.", "????...."]);
    let result = segment(&light, &valid, &params(1, 1));
    assert_eq!(drawn(&result.mask), ["........", ".....##.", ".....##.", "........"]);
    assert!((result.metrics.threshold - 0.48).abs() < 0.01);
}

#[test]
fn an_object_at_the_border_gets_a_warning() {
    let (light, valid) = scene(&["....##..", "....##..", "........", "........"]);
    let result = segment(&light, &valid, &params(1, 1));
    assert_eq!(codes(&result), ["mask_touches_border"]);
    assert!((result.metrics.border_contact_fraction - 2.0 / 20.0).abs() < 1e-12);
}

#[test]
fn a_background_darker_than_the_object_gets_a_warning() {
    let (light, valid) = scene(&["########", "###..###", "###..###", "########"]);
    assert_eq!(codes(&segment(&light, &valid, &params(1, 1))), ["mask_inverted"]);
}

/// A picture of `width` x `height` px from shares of full scale, with noise of about one grey level.
fn picture(width: usize, height: usize, share: impl Fn(f64, f64) -> f64) -> Raster {
    let at = |at: usize| {
        let (x, y) = (at % width, at / width);
        let noise = ((x * 7919 + y * 104_729 + x * y) % 97) as f64 / 97.0 - 0.5;
        (255.0 * share(x as f64, y as f64) + 2.0 * noise).round().clamp(0.0, 255.0) as u8
    };
    Raster::eight(width, height, 1, (0..width * height).map(at).collect())
}

/// 0 inside a disc, 1 outside, with an edge of one pixel.
fn outside(x: f64, y: f64, centre: [f64; 2], radius: f64) -> f64 {
    ((x - centre[0]).hypot(y - centre[1]) - radius + 0.5).clamp(0.0, 1.0)
}

fn of_all(raster: &Raster, params: &MaskParams) -> Silhouette {
    segment(raster, &Plane::filled(raster.width, raster.height, 255u8), params)
}

#[test]
fn a_translucent_wing_is_object_and_gets_a_warning() {
    let at = |passes: f64| {
        picture(300, 200, move |x, y| {
            let (body, wing) = (outside(x, y, [120.0, 100.0], 45.0), outside(x, y, [190.0, 90.0], 40.0));
            0.03 + 0.85 * body * (passes + (1.0 - passes) * wing)
        })
    };
    for passes in [0.3, 0.5, 0.7] {
        let result = of_all(&at(passes), &params(10, 10));
        assert_eq!(codes(&result), ["mask_translucent"], "{passes}");
        for (x, y) in [(120, 100), (190, 90), (215, 90), (190, 120)] {
            assert_eq!(result.mask.at(x, y), 255, "{passes} at {x}, {y}");
        }
        for (x, y) in [(236, 90), (190, 136), (120, 150), (60, 60)] {
            assert_eq!(result.mask.at(x, y), 0, "{passes} at {x}, {y}");
        }
        let translucent = result.metrics.translucent_fraction;
        assert!((0.2..0.5).contains(&translucent), "{passes}: {translucent}");
        assert!((result.metrics.threshold - 0.455).abs() < 0.03, "{passes}: {:?}", result.metrics);
    }
    let opaque = of_all(&at(0.0), &params(10, 10));
    assert_eq!((codes(&opaque).len(), opaque.metrics.translucent_fraction), (0, 0.0));
    // a fixed threshold applies as it is
    let fixed = of_all(&at(0.7), &MaskParams { threshold: MaskThreshold::Fixed(0.4), ..params(10, 10) });
    assert_eq!((codes(&fixed).len(), fixed.mask.at(215, 90)), (0, 0));
}

#[test]
fn a_reflection_on_the_object_is_filled_and_a_hole_is_kept() {
    let light = picture(300, 200, |x, y| {
        let body = outside(x, y, [150.0, 100.0], 80.0);
        let glint = 0.45 * (1.0 - outside(x, y, [120.0, 80.0], 6.0));
        let flash = 1.0 - outside(x, y, [180.0, 120.0], 4.0);
        let window = 0.77 * (1.0 - outside(x, y, [180.0, 80.0], 6.0));
        (0.03 + 0.77 * body + glint.max(flash).max(window)).min(1.0)
    });
    let result = of_all(&light, &params(4, 4));
    assert_eq!((result.mask.at(120, 80), result.mask.at(180, 120)), (255, 255), "reflections");
    assert_eq!((result.mask.at(180, 80), result.metrics.holes), (0, 1), "a window");
}

#[test]
fn an_uneven_light_is_evened_out_and_gets_a_warning_when_it_is_extreme() {
    let lit = |falloff: f64| {
        picture(300, 200, move |x, y| {
            let light = 0.9 * (1.0 - falloff * x / 299.0);
            0.02 + light * outside(x, y, [150.0, 100.0], 60.0)
        })
    };
    let truth = of_all(&lit(0.0), &params(4, 4)).mask;
    for falloff in [0.2, 0.4, 0.6, 0.8] {
        let result = of_all(&lit(falloff), &params(4, 4));
        let differ = result.mask.data.iter().zip(&truth.data).filter(|(a, b)| a != b).count();
        assert!(differ < 60, "{falloff}: {differ} px of {}", truth.data.len());
        // the constant offset of 0.02 lessens the falloff
        assert!((result.metrics.light_falloff.unwrap() - falloff * 0.9 / 0.92).abs() < 0.05, "{:?}", result.metrics);
        let expected: &[&str] = if falloff > 0.7 { &["mask_uneven_light"] } else { &[] };
        assert_eq!(codes(&result), expected, "{falloff}");
    }
}

#[test]
fn soft_alpha_is_the_share_of_the_pixel_that_the_object_covers() {
    let light = picture(300, 200, |x, y| {
        let body = outside(x, y, [150.0, 100.0], 40.0);
        // a hair of 0.4 px that sticks out of it
        let hair = if (140.0..290.0).contains(&x) { (0.9 - (y - 100.3).abs()).clamp(0.0, 0.4) } else { 0.0 };
        0.03 + 0.8 * body * (1.0 - hair)
    });
    let hard = of_all(&light, &params(4, 4));
    assert_eq!(hard.soft_alpha, None);
    assert_eq!(hard.image_alpha(), &hard.mask);
    let soft = of_all(&light, &MaskParams { edge: MaskEdge::Soft, ..params(4, 4) });
    assert_eq!(soft.mask, hard.mask);
    let alpha = soft.image_alpha();
    for (at, (&soft, &hard)) in alpha.data.iter().zip(&hard.mask.data).enumerate() {
        assert_eq!(soft >= 128, hard == 255, "at {at}");
    }
    // the hair is too thin for the hard mask; the soft alpha keeps 0.4 of a pixel
    assert_eq!(hard.mask.at(250, 100), 0);
    assert!((f64::from(alpha.at(250, 100)) / 255.0 - 0.4).abs() < 0.05, "{}", alpha.at(250, 100));
    let mut worst = 0.0f64;
    for y in 20..96 {
        for x in 60..240 {
            let truth = 1.0 - outside(x as f64, y as f64, [150.0, 100.0], 40.0);
            worst = worst.max((f64::from(alpha.at(x, y)) / 255.0 - truth).abs());
        }
    }
    assert!(worst < 0.16, "{worst}");
    assert!(alpha.row(190).iter().all(|&v| v == 0));
}

#[test]
fn the_tip_of_a_hair_is_kept_when_faint_pixels_connect_it() {
    let hair = |gap: u8| {
        let at = |at: usize| match (at % 40, at / 40) {
            (2..=12, 5..=15) => 20u8,
            (13..=20 | 24..=26, 10) => 20,
            (21..=23, 10) => gap,
            _ => 220,
        };
        Raster::eight(40, 20, 1, (0..800).map(at).collect())
    };
    let tip = |gap: u8| of_all(&hair(gap), &params(8, 4)).mask.at(25, 10);
    assert_eq!((tip(150), tip(220)), (255, 0));
    assert_eq!(of_all(&hair(150), &params(8, 4)).metrics.components, 1);
}

#[test]
fn black_white_and_low_contrast_pictures_get_warnings() {
    let plain = |value: u8| Raster::eight(16, 16, 1, vec![value; 256]);
    let all = Plane::filled(16, 16, 255u8);
    let black = segment(&plain(0), &all, &params(4, 4));
    assert_eq!(codes(&black), ["mask_full"]);
    assert_eq!(black.metrics.separability, None);
    assert_eq!(codes(&segment(&plain(255), &all, &params(4, 4))), ["mask_empty"]);
    let noise = Raster::eight(16, 16, 1, (0..256u32).map(|i| 100 + (i * 37 % 101 * 53 % 17) as u8).collect());
    let fixed = MaskParams { threshold: MaskThreshold::Fixed(101.0 / 255.0), ..params(1, 1) };
    assert!(codes(&segment(&noise, &all, &fixed)).contains(&"mask_low_separability"));
}

#[test]
fn a_dim_back_light_without_an_object_is_full_and_not_translucent() {
    let dim = of_all(&picture(200, 150, |_, _| 77.0 / 255.0), &params(4, 4));
    assert_eq!((codes(&dim), dim.metrics.translucent_fraction), (vec!["mask_full"], 0.0));
}

#[test]
fn a_fixed_threshold_is_a_share_of_full_scale_at_either_depth() {
    let fixed = MaskParams { threshold: MaskThreshold::Fixed(0.5), ..params(1, 1) };
    let all = Plane::filled(4, 1, 255u8);
    let eight = Raster::eight(4, 1, 1, vec![10, 127, 128, 250]);
    let sixteen = Raster::sixteen(4, 1, 1, vec![10, 32_767, 32_768, 65_000]);
    for light in [eight, sixteen] {
        assert_eq!(segment(&light, &all, &fixed).mask.data, [255, 255, 0, 0]);
    }
}

#[test]
fn the_default_limits_follow_the_size_of_the_picture() {
    let limits = |width, height| {
        let params = MaskParams::default_for(width, height);
        (params.min_blob_px, params.min_hole_px)
    };
    assert_eq!(limits(6000, 4000), (480, 120));
    assert_eq!(limits(100, 100), (4, 4));
}

#[test]
fn components_are_those_of_a_flood_fill() {
    let (width, height) = (57, 43);
    let dark = |x: usize, y: usize| (x * 7919 + y * 104_729 + x * x * y) % 13 < 6;
    let light = Plane::from_fn(width, height, |x, y| if dark(x, y) { 20u8 } else { 230 });
    let all = Plane::filled(width, height, 255u8);
    let raster = Raster::eight(width, height, 1, light.data.clone());
    for least in [1, 3, 8, 20] {
        let result = segment(&raster, &all, &params(least, 0));
        let mut seen = vec![false; width * height];
        let mut kept = 0;
        for start in 0..width * height {
            if light.data[start] != 20 || seen[start] {
                continue;
            }
            let (mut stack, mut part) = (vec![start], Vec::new());
            seen[start] = true;
            while let Some(at) = stack.pop() {
                part.push(at);
                let (x, y) = (at % width, at / width);
                for v in y.saturating_sub(1)..(y + 2).min(height) {
                    for u in x.saturating_sub(1)..(x + 2).min(width) {
                        let next = v * width + u;
                        if light.data[next] == 20 && !seen[next] {
                            seen[next] = true;
                            stack.push(next);
                        }
                    }
                }
            }
            let stays = part.len() >= least as usize;
            kept += u32::from(stays);
            assert!(part.iter().all(|&at| (result.mask.data[at] == 255) == stays), "part of {} px", part.len());
        }
        assert_eq!(result.metrics.components, kept);
    }
}
