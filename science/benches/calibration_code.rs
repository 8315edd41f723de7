//! The coded target beside the plain one: recognition, false alarms, and accuracy of the calibration.
//!
//! `cargo bench --bench calibration_code -- [--seeds N]` prints three tables.

use pinstack_science::{
    calibration::calibrate,
    synth::{DotTarget, Flaws, Glare, Rendered, Rig, Surround},
    types::{NoControl, calibration_options::CalibrationOptions},
};

/// What a stack shows.
#[derive(Clone, Copy)]
struct Case {
    name: &'static str,
    size: [usize; 2],
    columns: usize,
    /// Largest blur radius over the pitch.
    blur: f64,
    rotation: f64,
    adapt: fn(&mut Rig, &mut DotTarget),
}

fn unchanged(_: &mut Rig, _: &mut DotTarget) {}

const PLAIN: Case = Case { name: "", size: [600, 400], columns: 18, blur: 0.4, rotation: 0.7, adapt: unchanged };

fn cases() -> Vec<Case> {
    vec![
        Case { name: "blur 0.1 of the pitch", blur: 0.1, ..PLAIN },
        Case { name: "blur 0.3", blur: 0.3, ..PLAIN },
        Case { name: "blur 0.4", ..PLAIN },
        Case { name: "blur 0.5", blur: 0.5, ..PLAIN },
        Case { name: "blur 0.6", blur: 0.6, ..PLAIN },
        Case { name: "blur 0.7", blur: 0.7, ..PLAIN },
        Case { name: "rotated by 37 degrees", rotation: 37.0, ..PLAIN },
        Case { name: "fine, pitch 12 px", columns: 46, ..PLAIN },
        Case { name: "coarse, pitch 56 px", columns: 10, ..PLAIN },
        Case { name: "sRGB values", adapt: |_, target| target.flaws.gamma = true, ..PLAIN },
        Case { name: "noise 6 of 255", adapt: |rig, _| rig.noise = 6.0, ..PLAIN },
        Case { name: "tilted by 4 degrees", adapt: |_, target| target.tilt_deg = [4.0, -3.0], ..PLAIN },
        Case {
            name: "dust and glare",
            adapt: |_, target| {
                target.flaws = Flaws {
                    target_dust: 30,
                    sensor_dust: 5,
                    glare: vec![Glare { at: [0.3, 0.4], radius: 0.1, light: 0.3 }],
                    ..Flaws::default()
                };
            },
            ..PLAIN
        },
        Case {
            name: "10 x 6 dots on a table",
            adapt: |_, target| {
                (target.columns, target.rows) = (10, 6);
                target.flaws.surround = Some(Surround::table());
            },
            ..PLAIN
        },
        Case { name: "bright dots", adapt: |_, target| target.invert = true, ..PLAIN },
        Case { name: "moving lens", adapt: |rig, _| *rig = rig.clone().moving_lens(), ..PLAIN },
    ]
}

/// One calibrated stack.
struct Outcome {
    /// Worst distance of an image corner, px; `None` when the stack was refused.
    corner: Option<f64>,
    /// The same over its told standard deviation.
    over_sigma: f64,
    gain: f64,
    coded: bool,
}

fn run(case: &Case, coded: bool, missing: f64, seed: u64) -> Outcome {
    let mut rig = Rig { channels: 1, noise: 2.0, seed, ..Rig::sized(case.size[0], case.size[1], 7) };
    let mut target = DotTarget { rotation_deg: case.rotation, ..DotTarget::for_rig(&rig, case.columns) };
    (case.adapt)(&mut rig, &mut target);
    target.flaws.seed = seed;
    let last = rig.slices() - 1;
    let now = [0, last].map(|i| target.blur_radius_px(&rig, i) / target.pitch_px(&rig, i));
    rig.f_number *= now[0].max(now[1]) / case.blur;
    if coded {
        target.code = Some([(37 * seed) as i64 % 256, (59 * seed) as i64 % 256]);
    }
    let target = if missing > 0.0 { target.without(missing, seed) } else { target };
    let Ok(calibration) = calibrate(&Rendered::target(&rig, &target), &CalibrationOptions::default(), &NoControl)
    else {
        return Outcome { corner: None, over_sigma: f64::NAN, gain: f64::NAN, coded: false };
    };
    let (mut corner, mut over_sigma, mut gain) = (0.0_f64, 0.0_f64, 0.0_f64);
    for (i, slice) in calibration.slices.iter().enumerate().filter(|(i, _)| *i != rig.reference) {
        let error = slice.homography.corner_distance(&rig.homography(i), calibration.width, calibration.height);
        corner = corner.max(error);
        over_sigma = over_sigma.max(error / slice.corner_sigma_px.unwrap_or(f64::NAN));
        let ratio = if target.flaws.gamma { 1.0 } else { slice.gain / rig.gain(i) };
        gain = gain.max((ratio - 1.0).abs());
    }
    Outcome {
        corner: Some(corner),
        over_sigma,
        gain,
        coded: calibration.report.target.is_some_and(|target| target.coded),
    }
}

fn row(outcomes: &[Outcome]) -> String {
    let mut corners: Vec<f64> = outcomes.iter().filter_map(|o| o.corner).collect();
    corners.sort_by(f64::total_cmp);
    let most = |of: &dyn Fn(&Outcome) -> f64| outcomes.iter().map(of).fold(0.0, f64::max);
    match corners.last() {
        Some(worst) => format!(
            "{:>7.3} {worst:>7.3} {:>6.1} {:>7.2} {:>3}",
            corners[corners.len() / 2],
            most(&|o| o.over_sigma),
            100.0 * most(&|o| o.gain),
            outcomes.len() - corners.len()
        ),
        None => format!("{:>34}", "all refused"),
    }
}

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let value = |name: &str| arguments.iter().position(|a| a == name).and_then(|k| arguments.get(k + 1));
    let seeds: u64 = value("--seeds").and_then(|n| n.parse().ok()).unwrap_or(4);
    let only = value("--only").cloned().unwrap_or_default();
    println!(
        "Worst image corner (median and maximum over {seeds} seeds, px; maximum over the told sigma), gain (maximum, %), refused"
    );
    println!("{:<26} {:^34}   {:^34}  recognised", "", "plain target", "coded target");
    for case in cases().iter().filter(|case| case.name.contains(&only)) {
        let plain: Vec<Outcome> = (1..=seeds).map(|seed| run(case, false, 0.0, seed)).collect();
        let coded: Vec<Outcome> = (1..=seeds).map(|seed| run(case, true, 0.0, seed)).collect();
        let recognised = coded.iter().filter(|o| o.coded).count();
        println!("{:<26} {}   {}  {recognised} of {seeds}", case.name, row(&plain), row(&coded));
    }
    if only.is_empty() {
        let shares = [0.0, 0.02, 0.05, 0.1];
        let alarms = shares.map(|missing| (1..=2 * seeds).filter(|s| run(&PLAIN, false, missing, *s).coded).count());
        println!("Plain targets taken for coded ones, of {} each with missing dots {shares:?}: {alarms:?}", 2 * seeds);
    }
}
