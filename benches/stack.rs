//! What fusing a stack costs, stage by stage, beside what decoding its slices costs alone:
//! `cargo bench --bench stack -- [--quick | --large] [--only typical|dense|sixteen] [--slices N] [--threads N]
//! [--no-enfuse]`. `--quick` leaves out the large pictures, `--large` the small ones. `METHOD=guided|pyramid|unveiled`
//! in the environment says how slices are fused.
//!
//! Each row of the table is a process of its own, so that its peak of memory is its own. CPU time counts, not wall time,
//! because others may be using the machine; the ratio to the decoder in the same run is the figure to watch. Files come
//! from the disk's cache. `enfuse` is shown beside it where it is installed: it gets the warped slices as TIFF files, so
//! that it does only what the two passes do.

use std::{
    env,
    fs::{self, File},
    io::{BufWriter, Write},
    path::{Path, PathBuf},
    process::{Command, Stdio},
    sync::Mutex,
    time::{Duration, Instant},
};

use pinstack::{
    archive::{ArchiveLimits, StackArchive, open, pack},
    fusion::{
        Plan, Watch, fuse,
        mask::{MaskParams, cut_out},
    },
    imaging::{
        Plane, Raster, Rect, Samples, Slices, codec,
        codec::Metadata,
        filter::saliency::{Rows, Saliency},
        grey,
        warp::Warp,
    },
    model::{
        Cancelled, Control,
        options::{GuidedParams, Method, StackOptions},
    },
    synth::{
        Light, Rig, Scene, Stage,
        scene::{Part, Pattern, Relief, Shape, Skin},
    },
};
use rayon::prelude::*;

const ENFUSE: [&str; 5] =
    ["--hard-mask", "--exposure-weight=0", "--saturation-weight=0", "--contrast-weight=1", "--gray-projector=l-star"];

/// Rendered size, from which larger pictures are put together.
const RENDERED: (usize, usize) = (1800, 1200);
const LARGE: (usize, usize) = (6000, 4000);

#[derive(Debug, Clone, Copy)]
struct Case {
    /// Texture everywhere, or an insect before a plain ground.
    dense: bool,
    width: usize,
    height: usize,
    sixteen: bool,
    slices: usize,
}

impl Case {
    fn rig(self) -> Rig {
        Rig::sized(self.width, self.height, self.slices)
    }

    fn plan(self) -> Plan {
        let rig = self.rig();
        Plan {
            width: self.width,
            height: self.height,
            homographies: (0..self.slices).map(|i| rig.homography(i)).collect(),
            gains: (0..self.slices).map(|i| rig.gain(i)).collect(),
            reference: rig.reference,
            // METHOD=guided|pyramid|unveiled
            method: std::env::var("METHOD").map_or_else(
                |_| Method::default(),
                |name| serde_json::from_value(name.into()).expect("METHOD is guided, pyramid or unveiled"),
            ),
            params: GuidedParams::default(),
            rail: None,
            near_first: Some(true),
        }
    }

    fn name(self) -> String {
        format!(
            "{}, {:.1} MP, {} slices of {} bits",
            if self.dense { "dense" } else { "typical" },
            (self.width * self.height) as f64 / 1e6,
            self.slices,
            if self.sixteen { 16 } else { 8 }
        )
    }

    /// The words by which a child is told which case it is about.
    fn words(self) -> [String; 5] {
        let flag = |flag: bool| usize::from(flag).to_string();
        [flag(self.dense), self.width.to_string(), self.height.to_string(), flag(self.sixteen), self.slices.to_string()]
    }

    fn of(words: &[String]) -> Self {
        let number = |i: usize| words[i].parse::<usize>().expect("a number");
        Self { dense: number(0) == 1, width: number(1), height: number(2), sixteen: number(3) == 1, slices: number(4) }
    }

    fn archive(self, folder: &Path) -> StackArchive {
        open(&folder.join("stack.zip"), &ArchiveLimits::default()).expect("our own zip can be read")
    }
}

fn scene(dense: bool) -> Scene {
    let mut scene = Scene::insect(1);
    if dense {
        scene.parts = vec![Part {
            shape: Shape::Plate { centre: [0.0; 2], half: [2.0; 2], angle: 0.0, corner: 0.0 },
            holes: Vec::new(),
            relief: Relief::Dome { centre: [0.0; 2], depth: 0.7, slope: [0.3, 0.25], bulge: 0.3, radius: 0.5 },
            skin: Skin {
                base: [0.5, 0.4, 0.3],
                accent: [0.2, 0.3, 0.5],
                pattern: Pattern::Mottled,
                grain: 0.8,
                gloss: 0.0,
                seed: 1,
            },
        }];
    }
    scene
}

/// Writes the zip of a case. Pictures that are larger than [`RENDERED`] are mirrored copies of it side by side, put
/// together on the canvas and then seen through the homographies of the large rig, with noise of their own.
fn make(case: Case, folder: &Path) {
    let small = Rig::sized(RENDERED.0, RENDERED.1, case.slices);
    let stage = Stage::new(&small, &scene(case.dense));
    let rig = case.rig();
    let members = (0..case.slices).map(|i| {
        let mut slice = stage.render(Light::Front, i);
        if (case.width, case.height) != RENDERED {
            slice = enlarged(case, &slice, &small, &rig, i);
        }
        match case.sixteen {
            false => (format!("front/{i:02}.jpg"), codec::encode_jpeg(&slice, 95)),
            true => {
                let mut file = Vec::new();
                codec::encode_png(&mut file, &in_sixteen(slice, i), &Metadata::default()).expect("memory");
                (format!("front/{i:02}.png"), file)
            }
        }
    });
    pack(BufWriter::new(File::create(folder.join("stack.zip")).expect("a file")), members).expect("a zip");
}

fn eight(raster: Raster) -> Vec<u8> {
    match raster.samples {
        Samples::Eight(samples) => samples,
        Samples::Sixteen(samples) => samples.iter().map(|&v| (v >> 8) as u8).collect(),
    }
}

fn enlarged(case: Case, slice: &Raster, small: &Rig, rig: &Rig, i: usize) -> Raster {
    let warp = Warp::new(&small.homography(i), 1.0, RENDERED, RENDERED).expect("a regular homography");
    let aligned = warp.apply(eight(slice.clone()), 3);
    // beyond this margin every slice covers the canvas
    let margin = [RENDERED.0 / 25, RENDERED.1 / 25];
    let mirrored = |x: usize, length: usize, margin: usize| {
        let length = length - 2 * margin;
        margin + if (x / length).is_multiple_of(2) { x % length } else { length - 1 - x % length }
    };
    let (width, height) = (case.width, case.height);
    let mut canvas = vec![0u8; width * height * 3];
    canvas.par_chunks_exact_mut(width * 3).enumerate().for_each(|(y, row)| {
        let from = mirrored(y, RENDERED.1, margin[1]) * RENDERED.0;
        for (x, pixel) in row.chunks_exact_mut(3).enumerate() {
            let at = (from + mirrored(x, RENDERED.0, margin[0])) * 3;
            pixel.copy_from_slice(&aligned[at..at + 3]);
        }
    });
    let away = rig.homography(i).inverse().expect("a regular homography");
    let warp = Warp::new(&away, 1.0, (width, height), (width, height)).expect("a regular homography");
    let mut samples = warp.apply(canvas, 3);
    samples.par_chunks_mut(width * 3).enumerate().for_each(|(y, row)| {
        let mut state =
            (i as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ (y as u64).wrapping_mul(0xC2B2_AE3D_27D4_EB4F);
        for sample in row {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            // two dice: a standard deviation of about 1 of 255
            let noise = (state >> 40) % 3 + (state >> 50) % 3;
            *sample = sample.saturating_add(noise as u8).saturating_sub(2);
        }
    });
    Raster::eight(width, height, 3, samples)
}

fn in_sixteen(slice: Raster, i: usize) -> Raster {
    let (width, height, channels) = (slice.width, slice.height, slice.channels);
    let fine = |at: usize| (at.wrapping_mul(40_503) ^ (i * 7_919)) as u16 & 0xFF;
    let samples = eight(slice).iter().enumerate().map(|(at, &v)| u16::from(v) << 8 | fine(at)).collect();
    Raster::sixteen(width, height, channels, samples)
}

/// CPU time of all threads of this process that are alive.
fn cpu() -> Duration {
    let threads = fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
    let of_thread = |folder: PathBuf| -> Option<u64> {
        fs::read_to_string(folder.join("schedstat")).ok()?.split_whitespace().next()?.parse().ok()
    };
    Duration::from_nanos(threads.filter_map(|thread| of_thread(thread.path())).sum())
}

/// Peak of memory of a process, MB.
fn peak_mb(process: &str) -> Option<f64> {
    let status = fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    Some(line.split_whitespace().next()?.parse::<f64>().ok()? * 1024.0 / 1e6)
}

/// What a row of the table says.
#[derive(Debug, Clone, Copy)]
struct Cost {
    cpu: f64,
    wall: f64,
    peak_mb: Option<f64>,
}

/// Time spent in what is given to it.
#[derive(Default)]
struct Watchmaker(Mutex<(Duration, Duration)>);

impl Watchmaker {
    fn time<T>(&self, work: impl FnOnce() -> T) -> T {
        let (cpu_before, wall_before) = (cpu(), Instant::now());
        let result = work();
        let mut sums = self.0.lock().expect("nobody panicked");
        sums.0 += cpu() - cpu_before;
        sums.1 += wall_before.elapsed();
        result
    }

    fn cost(&self) -> Cost {
        let (cpu, wall) = *self.0.lock().expect("nobody panicked");
        Cost { cpu: cpu.as_secs_f64(), wall: wall.as_secs_f64(), peak_mb: peak_mb("self") }
    }
}

/// Notes when the second pass begins.
struct Passes(Mutex<Option<(Duration, Instant)>>);

impl Control for Passes {
    fn progress(&self, stage: &'static str, _completed: usize, _total: usize) {
        let mut second = self.0.lock().expect("nobody panicked");
        if stage == "fusing" && second.is_none() {
            *second = Some((cpu(), Instant::now()));
        }
    }

    fn check(&self) -> Result<(), Cancelled> {
        Ok(())
    }
}

/// The stages that are measured, each in a process of its own.
const STAGES: [&str; 9] = [
    "decode only",
    "warp",
    "saliency",
    "first pass",
    "second pass",
    "whole",
    "with metrics",
    "back light",
    "PNG of the result",
];

/// What the child does: one stage.
fn stage(name: &str, case: Case, folder: &Path) -> Cost {
    let archive = case.archive(folder);
    let (plan, size) = (case.plan(), (case.width, case.height));
    let watch = Watchmaker::default();
    let warp = |i: usize| Warp::new(&plan.homographies[i], plan.gains[i], size, size).expect("a regular homography");
    let fused = |control: &dyn Control| {
        fuse(archive.front(), &plan, &Watch::default(), folder, control).expect("it can be fused")
    };
    let started = (cpu(), Instant::now());
    let passes = Passes(Mutex::new(None));
    let since = |(cpu_then, wall_then): (Duration, Instant)| Cost {
        cpu: (cpu() - cpu_then).as_secs_f64(),
        wall: wall_then.elapsed().as_secs_f64(),
        peak_mb: peak_mb("self"),
    };
    match name {
        "decode only" => {
            let load = |i: usize| archive.front().load(i).expect("a slice").width;
            (0..case.slices).into_par_iter().with_max_len(1).map(load).sum::<usize>();
            since(started)
        }
        "warp" => {
            let (mut eights, mut sixteens) = (Vec::new(), Vec::new());
            for i in 0..case.slices {
                let going_on = || Ok::<(), Cancelled>(());
                match archive.front().load(i).expect("a slice").samples {
                    Samples::Eight(samples) => {
                        eights =
                            watch.time(|| warp(i).apply_unless(samples, 3, eights, going_on)).expect("not cancelled");
                    }
                    Samples::Sixteen(samples) => {
                        sixteens =
                            watch.time(|| warp(i).apply_unless(samples, 3, sixteens, going_on)).expect("not cancelled");
                    }
                }
            }
            watch.cost()
        }
        "saliency" => {
            let saliency = Saliency::new(plan.params.r_g as usize, plan.params.sigma_g);
            for i in 0..case.slices {
                let raster = archive.front().load(i).expect("a slice");
                let row = |y: usize, out: &mut [f32]| {
                    let samples = y * case.width * 3..(y + 1) * case.width * 3;
                    match &raster.samples {
                        Samples::Eight(all) => grey::luma_row(&all[samples], 3, out),
                        Samples::Sixteen(all) => grey::luma_row(&all[samples], 3, out),
                    }
                };
                let bands = (0..case.height).into_par_iter().step_by(128);
                watch.time(|| {
                    bands.for_each_init(Rows::default, |buffers, y| {
                        saliency.rows(size, y..(y + 128).min(case.height), buffers, row, |_, _, values| {
                            std::hint::black_box(values);
                        });
                    });
                });
            }
            watch.cost()
        }
        "with metrics" => {
            let watch = Watch { metrics: true, object: None };
            fuse(archive.front(), &plan, &watch, folder, &passes).expect("it can be fused");
            since(started)
        }
        // what a back light costs beside the front: slices like those of the front, fused as a job does, and cut out
        "back light" => {
            let plan = Plan { method: Method::Guided, ..plan };
            let back = fuse(archive.front(), &plan, &Watch::default(), folder, &passes).expect("it can be fused");
            let params = MaskParams::from_options(&StackOptions::default(), case.width, case.height);
            std::hint::black_box(cut_out(&back.image, &back.valid, &params));
            since(started)
        }
        "PNG of the result" => {
            let image = fused(&passes).image;
            let file = || BufWriter::new(File::create(folder.join("fused.png")).expect("a file"));
            watch.time(|| codec::encode_png(file(), &image, &Metadata::default())).expect("a PNG");
            watch.cost()
        }
        _ => {
            fused(&passes);
            let second = passes.0.lock().expect("nobody panicked").expect("there is a second pass");
            let (whole, second) = (since(started), since(second));
            match name {
                "first pass" => Cost { cpu: whole.cpu - second.cpu, wall: whole.wall - second.wall, ..whole },
                "second pass" => second,
                _ => whole,
            }
        }
    }
}

/// Runs a stage in a child, and reads its cost.
fn cost(name: &str, case: Case, folder: &Path, threads: usize) -> Cost {
    let output = Command::new(env::current_exe().expect("our own path"))
        .args(["--stage", name, folder.to_str().expect("a path in UTF-8")])
        .args(case.words())
        .env("RAYON_NUM_THREADS", threads.to_string())
        .stderr(Stdio::inherit())
        .output()
        .expect("a child");
    assert!(output.status.success(), "{name} of {} failed", case.name());
    let words = String::from_utf8(output.stdout).expect("numbers");
    let numbers: Vec<f64> = words.split_whitespace().map(|word| word.parse().expect("a number")).collect();
    Cost { cpu: numbers[0], wall: numbers[1], peak_mb: Some(numbers[2]).filter(|mb| *mb > 0.0) }
}

/// What `enfuse` needs for the same slices, when it is installed.
fn enfuse(case: Case, folder: &Path) -> Option<Cost> {
    Command::new("enfuse").arg("--version").output().ok()?;
    let (archive, plan, size) = (case.archive(folder), case.plan(), (case.width, case.height));
    let files: Vec<PathBuf> = (0..case.slices)
        .map(|i| {
            let warp = Warp::new(&plan.homographies[i], plan.gains[i], size, size).expect("a regular homography");
            let raster = archive.front().load(i).expect("a slice");
            let samples = match raster.samples {
                Samples::Eight(samples) => Samples::Eight(warp.apply(samples, 3)),
                Samples::Sixteen(samples) => Samples::Sixteen(warp.apply(samples, 3)),
            };
            let path = folder.join(format!("{i:02}.tif"));
            let file = BufWriter::new(File::create(&path).expect("a file"));
            codec::encode_tiff(file, &with_alpha(samples, &warp, size), &Metadata::default()).expect("a TIFF");
            path
        })
        .collect();
    let (before, started) = (children(), Instant::now());
    let mut child = Command::new("enfuse")
        .args(ENFUSE)
        .arg("-o")
        .arg(folder.join("enfuse.tif"))
        .args(&files)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .ok()?;
    let mut peak = None;
    let status = loop {
        peak = peak_mb(&child.id().to_string()).or(peak);
        match child.try_wait().ok()? {
            Some(status) => break status,
            None => std::thread::sleep(Duration::from_millis(20)),
        }
    };
    files.iter().for_each(|file| drop(fs::remove_file(file)));
    status.success().then(|| Cost { cpu: children() - before, wall: started.elapsed().as_secs_f64(), peak_mb: peak })
}

/// The warped slice with what it covers as alpha.
fn with_alpha(samples: Samples, warp: &Warp, (width, height): (usize, usize)) -> Raster {
    fn joined<T: Copy>(samples: &[T], mask: &Plane<u8>, full: T, none: T) -> Vec<T> {
        let alpha = |&covered: &u8| if covered == 0 { none } else { full };
        samples.chunks_exact(3).zip(&mask.data).flat_map(|(p, covered)| [p[0], p[1], p[2], alpha(covered)]).collect()
    }
    let mask = warp.coverage().mask(Rect::whole(width, height));
    match samples {
        Samples::Eight(samples) => Raster::eight(width, height, 4, joined(&samples, &mask, u8::MAX, 0)),
        Samples::Sixteen(samples) => Raster::sixteen(width, height, 4, joined(&samples, &mask, u16::MAX, 0)),
    }
}

/// CPU time of the children that have ended, s, as the system counts it: in hundredths.
fn children() -> f64 {
    let stat = fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // the fields after the name, which is in brackets: user and system time of children are the 14th and 15th
    let fields: Vec<&str> = stat.rsplit(')').next().unwrap_or("").split_whitespace().collect();
    let ticks = |i: usize| fields.get(i).and_then(|ticks| ticks.parse::<f64>().ok()).unwrap_or(0.0);
    (ticks(13) + ticks(14)) / 100.0
}

fn line(name: &str, cost: Cost, decode: Option<Cost>, pixels: f64) {
    let ratio = decode.map_or(String::new(), |decode| format!("{:.2}", cost.cpu / decode.cpu));
    let peak = cost.peak_mb.map_or(String::new(), |mb| format!("{mb:.0}"));
    let each = cost.cpu * 1e9 / pixels;
    println!("| {name:<17} | {:>8.3} | {:>8.3} | {each:>7.2} | {ratio:>8} | {peak:>7} |", cost.cpu, cost.wall);
    std::io::stdout().flush().expect("someone reads");
}

fn main() {
    let arguments: Vec<String> = env::args().skip(1).filter(|word| word != "--bench").collect();
    if let [flag, name, folder, case @ ..] = arguments.as_slice()
        && flag == "--stage"
    {
        let cost = stage(name, Case::of(case), Path::new(folder));
        println!("{} {} {}", cost.cpu, cost.wall, cost.peak_mb.unwrap_or(0.0));
        return;
    }
    let has = |flag: &str| arguments.iter().any(|word| word == flag);
    let number = |flag: &str, otherwise: usize| {
        let at = arguments.iter().position(|word| word == flag);
        at.and_then(|at| arguments.get(at + 1)?.parse().ok()).unwrap_or(otherwise)
    };
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let (slices, threads) = (number("--slices", 10), number("--threads", cores));
    let only = arguments.iter().position(|word| word == "--only").and_then(|at| arguments.get(at + 1));
    let sizes = match (has("--quick"), has("--large")) {
        (true, _) => vec![RENDERED],
        (_, true) => vec![LARGE],
        _ => vec![RENDERED, LARGE],
    };

    println!("{threads} threads; CPU and wall time in s, CPU time per pixel of all slices, peak memory in MB");
    for (width, height) in sizes {
        for (kind, dense, sixteen) in [("typical", false, false), ("dense", true, false), ("sixteen", false, true)] {
            if only.is_some_and(|only| only != kind) {
                continue;
            }
            let case = Case { dense, width, height, sixteen, slices };
            let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).expect("a folder");
            make(case, folder.path());
            let zip = fs::metadata(folder.path().join("stack.zip")).expect("the zip").len() as f64;
            println!("\n{} ({:.1} MB per slice)", case.name(), zip / 1e6 / slices as f64);
            println!("| stage             |      CPU |     wall |   ns/px | x decode | peak MB |");
            println!("|-------------------|---------:|---------:|--------:|---------:|--------:|");
            let pixels = (width * height * slices) as f64;
            let mut decode = None;
            for name in STAGES {
                let cost = cost(name, case, folder.path(), threads);
                let decode = *decode.get_or_insert(cost);
                line(name, cost, Some(decode), pixels);
            }
            if !has("--no-enfuse")
                && let Some(cost) = enfuse(case, folder.path())
            {
                line("enfuse", cost, decode, pixels);
            }
        }
    }
}
