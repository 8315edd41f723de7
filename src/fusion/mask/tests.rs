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
    MaskParams { threshold: MaskThreshold::Auto, min_blob_px, min_hole_px }
}

fn drawn(alpha: &Plane<u8>) -> Vec<String> {
    let letter = |&v: &u8| if v == 255 { '#' } else { '.' };
    (0..alpha.height).map(|y| alpha.row(y).iter().map(letter).collect()).collect()
}

fn codes(silhouette: &Silhouette) -> Vec<&str> {
    silhouette.warnings.iter().map(|warning| warning.code.as_str()).collect()
}

#[test]
fn the_dark_object_is_cut_out_small_parts_go_and_small_holes_are_filled() {
    let (light, valid) = scene(&[
        "............",
        ".#######..#.",
        ".#.####.....",
        ".####..#....",
        ".####..#..#.",
        ".#######.#..",
        "............",
    ]);
    let result = cut_out(&light, &valid, &params(3, 4));
    assert_eq!(
        drawn(&result.alpha),
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
    // background over corners is not one hole: the notch at the right is closed by edges
    assert_eq!((result.metrics.components, result.metrics.holes), (1, 1));
    assert_eq!(codes(&result), [] as [&str; 0]);
    assert!((result.metrics.threshold - (220.0 + 25.0) / 2.0 / 255.0).abs() < 0.01);
    assert!(result.metrics.separability.unwrap() > 0.999);
    assert_eq!(result.metrics.border_contact_fraction, 0.0);
    let object = result.alpha.data.iter().filter(|&&v| v == 255).count();
    assert!((result.metrics.foreground_fraction - object as f64 / 84.0).abs() < 1e-12);
}

#[test]
fn a_hair_that_goes_over_corners_is_one_part() {
    let (light, valid) = scene(&["........", ".#......", "..#.....", "...#....", "....#...", "........"]);
    assert_eq!(cut_out(&light, &valid, &params(4, 4)).metrics.components, 1);
    assert_eq!(codes(&cut_out(&light, &valid, &params(5, 4))), ["mask_empty"]);
}

#[test]
fn background_that_reaches_the_border_or_what_is_not_valid_is_no_hole() {
    let (light, valid) = scene(&["..####..", "..#.??..", "..####..", "#.######", "..#.####", "#.######"]);
    let result = cut_out(&light, &valid, &params(1, 4));
    assert_eq!(drawn(&result.alpha), ["..####..", "..#.....", "..####..", "#.######", "..######", "#.######"]);
    assert_eq!(result.metrics.holes, 0);
    assert_eq!(result.metrics.components, 3);
}

#[test]
fn what_is_not_valid_is_background_and_does_not_move_the_threshold() {
    let (light, valid) = scene(&["????....", "????.##.", "????.##.", "????...."]);
    let result = cut_out(&light, &valid, &params(1, 1));
    assert_eq!(drawn(&result.alpha), ["........", ".....##.", ".....##.", "........"]);
    assert!((result.metrics.threshold - 0.48).abs() < 0.01);
}

#[test]
fn an_object_at_the_border_is_told() {
    let (light, valid) = scene(&["....##..", "....##..", "........", "........"]);
    let result = cut_out(&light, &valid, &params(1, 1));
    assert_eq!(codes(&result), ["mask_touches_border"]);
    assert!((result.metrics.border_contact_fraction - 2.0 / 20.0).abs() < 1e-12);
}

#[test]
fn a_background_darker_than_the_object_is_told() {
    let (light, valid) = scene(&["########", "###..###", "###..###", "########"]);
    assert_eq!(codes(&cut_out(&light, &valid, &params(1, 1))), ["mask_inverted"]);
}

#[test]
fn black_white_and_grey_mush_are_told() {
    let plain = |value: u8| Raster::eight(16, 16, 1, vec![value; 256]);
    let all = Plane::filled(16, 16, 255u8);
    let black = cut_out(&plain(0), &all, &params(4, 4));
    assert_eq!(codes(&black), ["mask_full"]);
    assert_eq!(black.metrics.separability, None);
    assert_eq!(codes(&cut_out(&plain(255), &all, &params(4, 4))), ["mask_empty"]);
    let mush = Raster::eight(16, 16, 1, (0..256u32).map(|i| 100 + (i * 37 % 101 * 53 % 17) as u8).collect());
    let fixed = MaskParams { threshold: MaskThreshold::Fixed(101.0 / 255.0), ..params(1, 1) };
    assert!(codes(&cut_out(&mush, &all, &fixed)).contains(&"mask_low_separability"));
}

#[test]
fn a_fixed_threshold_is_a_share_of_full_scale_at_either_depth() {
    let fixed = MaskParams { threshold: MaskThreshold::Fixed(0.5), ..params(1, 1) };
    let all = Plane::filled(4, 1, 255u8);
    let eight = Raster::eight(4, 1, 1, vec![10, 127, 128, 250]);
    let sixteen = Raster::sixteen(4, 1, 1, vec![10, 32_767, 32_768, 65_000]);
    for light in [eight, sixteen] {
        assert_eq!(cut_out(&light, &all, &fixed).alpha.data, [255, 255, 0, 0]);
    }
}

#[test]
fn the_limits_follow_the_size_of_the_picture() {
    let limits = |width, height| {
        let params = MaskParams::from_options(&StackOptions::default(), width, height);
        (params.min_blob_px, params.min_hole_px)
    };
    assert_eq!(limits(6000, 4000), (480, 120));
    assert_eq!(limits(100, 100), (4, 4));
}

#[test]
fn parts_are_those_that_a_flood_fill_finds() {
    let (width, height) = (57, 43);
    let dark = |x: usize, y: usize| (x * 7919 + y * 104_729 + x * x * y) % 13 < 6;
    let light = Plane::from_fn(width, height, |x, y| if dark(x, y) { 20u8 } else { 230 });
    let all = Plane::filled(width, height, 255u8);
    let raster = Raster::eight(width, height, 1, light.data.clone());
    for least in [1, 3, 8, 20] {
        let result = cut_out(&raster, &all, &params(least, 0));
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
            assert!(part.iter().all(|&at| (result.alpha.data[at] == 255) == stays), "part of {} px", part.len());
        }
        assert_eq!(result.metrics.components, kept);
    }
}
