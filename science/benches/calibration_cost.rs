//! Cost of a full-size calibration compared with decoding its slices: 20 slices of 24 MP, read from a zip as in a job.
//! `cargo bench --bench calibration_cost -- [--quick] [--slices N]`
//!
//! CPU seconds are user and system time of the whole process. Memory is its peak during the calibration. Both come from
//! /proc, so this runs on Linux only.

use std::{fs, io::BufWriter, path::Path, time::Instant};

use pinstack_science::{
    archive::{ArchiveLimits, ArchivedSlices, open, pack},
    calibration::calibrate,
    imaging::{Raster, Slices, codec},
    synth::{DotTarget, Rig, render_target},
    types::{Interrupted, NoControl, calibration_options::CalibrationOptions},
};

/// Dot pitches in an image 6000 px wide.
const PITCHES_PX: [f64; 3] = [100.0, 150.0, 375.0];
/// Blur radius at the ends of the stack, over the pitch.
const BLUR: f64 = 0.4;
const QUALITY: u8 = 92;

struct Arguments {
    quick: bool,
    slices: Option<usize>,
}

fn arguments() -> Result<Arguments, String> {
    let mut found = Arguments { quick: false, slices: None };
    let mut rest = std::env::args().skip(1);
    while let Some(argument) = rest.next() {
        match argument.as_str() {
            // an argument that `cargo bench` adds
            "--bench" => {}
            "--quick" => found.quick = true,
            "--slices" => {
                let count = rest.next().and_then(|value| value.parse().ok()).filter(|&count| count >= 4);
                found.slices = Some(count.ok_or("--slices needs a number of at least 4")?);
            }
            other => return Err(format!("{other} is not known: --quick, --slices N")),
        }
    }
    Ok(found)
}

fn main() {
    let arguments = arguments().unwrap_or_else(|why| {
        eprintln!("{why}");
        std::process::exit(2)
    });
    let ([width, height], slices) = if arguments.quick { ([3000, 2000], 10) } else { ([6000, 4000], 20) };
    let slices = arguments.slices.unwrap_or(slices);
    println!("{width} x {height} px, JPEG quality {QUALITY}, blur at the ends {BLUR} of the pitch");
    println!(
        "{:>8} {:>7} | {:>12} {:>13} {:>6} | {:>13} {:>15} | {:>14} {:>13} | worst corner",
        "pitch px",
        "slices",
        "decode CPU s",
        "calibrate CPU",
        "ratio",
        "decode wall s",
        "calibrate wall",
        "RSS before MiB",
        "peak RSS MiB"
    );
    for pitch in PITCHES_PX {
        // the same number of dots at every image size
        let pitch = pitch * width as f64 / 6000.0;
        let folder = tempfile::tempdir().expect("a folder for temporary files");
        let (rig, target) = set_up(width, height, slices, pitch);
        let path = folder.path().join("target.zip");
        let started = Instant::now();
        write_stack(&rig, &target, &path);
        eprintln!("pitch {pitch}: rendered in {:.0} s", started.elapsed().as_secs_f64());
        let archive = open(&path, &ArchiveLimits::default()).expect("our own zip can be read");
        let halves = [slices / 2, slices];
        for count in halves {
            measure(&rig, pitch, &Middle::of(archive.front(), count));
        }
    }
}

/// A rig and a target that fills the image and is in focus in the middle slice.
fn set_up(width: usize, height: usize, slices: usize, pitch: f64) -> (Rig, DotTarget) {
    let mut rig = Rig { noise: 2.0, vignetting: 0.25, ..Rig::sized(width, height, slices) };
    let columns = (0.94 * width as f64 / pitch).floor() as usize;
    let mut target = DotTarget::for_rig(&rig, columns);
    let scale = pitch / target.pitch_px(&rig, rig.reference);
    target.pitch_mm *= scale;
    target.dot_diameter_mm *= scale;
    rig.f_number *= target.blur_radius_px(&rig, 0) / (BLUR * pitch);
    (rig, target)
}

fn write_stack(rig: &Rig, target: &DotTarget, path: &Path) {
    let members = (0..rig.slices())
        .map(|i| (format!("front/{i:03}.jpg"), codec::encode_jpeg(&render_target(rig, target, i), QUALITY)));
    pack(BufWriter::new(fs::File::create(path).expect("a file")), members).expect("a zip");
}

/// The middle slices of a stack.
struct Middle<'a> {
    all: &'a ArchivedSlices,
    first: usize,
    count: usize,
}

impl<'a> Middle<'a> {
    /// `count` slices around the middle of the stack.
    fn of(all: &'a ArchivedSlices, count: usize) -> Self {
        Self { all, first: all.count() / 2 - count / 2, count }
    }
}

impl Slices for Middle<'_> {
    fn count(&self) -> usize {
        self.count
    }

    fn name(&self, index: usize) -> &str {
        self.all.name(self.first + index)
    }

    fn load(&self, index: usize) -> Result<Raster, pinstack_science::types::Error> {
        self.all.load(self.first + index)
    }
}

/// Decodes all slices once, calibrates, and prints a row.
fn measure(rig: &Rig, pitch: f64, slices: &Middle) {
    let (cpu, wall) = (cpu_seconds(), Instant::now());
    for i in 0..slices.count() {
        let picture = slices.load(i).expect("a slice");
        assert_eq!(picture.width, rig.width);
    }
    let (decode, decode_wall) = (cpu_seconds() - cpu, wall.elapsed().as_secs_f64());
    let before = status_mib("VmRSS:");
    let watched = fs::write("/proc/self/clear_refs", "5").is_ok();
    let (cpu, wall) = (cpu_seconds(), Instant::now());
    let result = calibrate(slices, &CalibrationOptions::default(), &NoControl);
    let (spent, spent_wall) = (cpu_seconds() - cpu, wall.elapsed().as_secs_f64());
    let peak = if watched { format!("{:.0}", status_mib("VmHWM:")) } else { "-".into() };
    let corner = match &result {
        Ok(found) => {
            let [width, height] = [rig.width as u32, rig.height as u32];
            let error =
                |i: usize| found.slices[i].homography.corner_distance(&rig.homography(slices.first + i), width, height);
            format!("{:.3} px", (0..slices.count()).map(error).fold(0.0, f64::max))
        }
        Err(Interrupted::Failed(fault)) => format!("FAILED {}", fault.detail),
        Err(Interrupted::Cancelled(_)) => "cancelled".into(),
    };
    println!(
        "{pitch:>8} {:>7} | {decode:>12.2} {spent:>13.2} {:>6.2} | {decode_wall:>13.2} {spent_wall:>15.2} | {before:>14.0} {peak:>13} | {corner}",
        slices.count(),
        spent / decode
    );
}

/// User and system time of this process so far, s.
fn cpu_seconds() -> f64 {
    /// The unit of these fields: 1/100 s on every architecture of Linux.
    const TICKS_PER_SECOND: f64 = 100.0;
    let stat = fs::read_to_string("/proc/self/stat").expect("Linux has /proc/self/stat");
    // the name in brackets may contain blanks; utime and stime are fields 14 and 15, the 12th and 13th after it
    let behind = stat.rsplit(')').next().unwrap_or("");
    let ticks: f64 = behind.split_whitespace().skip(11).take(2).filter_map(|field| field.parse::<f64>().ok()).sum();
    ticks / TICKS_PER_SECOND
}

fn status_mib(field: &str) -> f64 {
    let status = fs::read_to_string("/proc/self/status").expect("Linux has /proc/self/status");
    let line = status.lines().find_map(|line| line.strip_prefix(field));
    let kib = line.and_then(|rest| rest.split_whitespace().next()).and_then(|kib| kib.parse::<f64>().ok());
    kib.unwrap_or(f64::NAN) / 1024.0
}
