//! Accuracy and time of the visual hull of rendered specimens with true and with disturbed poses: docs/HULL.md.
//!
//! `cargo bench --bench hull -- [--seeds 1,2,3] [--width 810] [--pans 18] [--tilts 0,8,16]` prints a table. Rendering
//! takes most of the time.

use std::{collections::HashMap, time::Instant};

use nalgebra::Vector3;
use pinstack_science::{
    hull::{HullOptions, Mesh, ViewPictures, from_views},
    imaging::{Plane, Raster},
    synth::turntable::{self, Solid, Specimen, Surface},
    types::{Error, NoControl, pinhole::PinholeCamera, view::ViewAngles},
};
use rayon::prelude::*;

/// Length of the edges of the true surface, mm.
const EDGE_MM: f64 = 0.1;
/// A part of the true surface counts if so many cameras see it, not more slanted than this.
const SEEN_BY: usize = 3;
const LEAST_COSINE: f64 = 0.25;
/// Side of the boxes in which the nearest vertex is looked for, mm.
const BOX_MM: f64 = 0.25;

struct Views(Vec<(Plane<u8>, Raster)>);

impl ViewPictures for Views {
    fn mask(&self, view: usize) -> Result<Plane<u8>, Error> {
        Ok(self.0[view].0.clone())
    }

    fn picture(&self, view: usize) -> Result<Option<Raster>, Error> {
        Ok(Some(self.0[view].1.clone()))
    }
}

/// What is changed of a scan with true poses and exact masks.
#[derive(Clone, Copy)]
enum Change {
    Nothing,
    /// Every second view alone.
    Half,
    /// Each picture shifted by a random amount of this standard deviation along each axis, px.
    Shifted(f64),
    /// The lower half of the mask of one view is missing.
    BadMask,
}

/// Name, change, tolerated views, and whether contradicting views are left out.
const CASES: [(&str, Change, usize, bool); 10] = [
    ("exact", Change::Nothing, 0, true),
    ("exact, 1 view tolerated", Change::Nothing, 1, true),
    ("exact, 2 views tolerated", Change::Nothing, 2, true),
    ("half of the views", Change::Half, 0, true),
    ("shifted, STD 0.5 px", Change::Shifted(0.5), 0, true),
    ("shifted, STD 0.5 px, 1 view tolerated", Change::Shifted(0.5), 1, true),
    ("shifted, STD 1 px", Change::Shifted(1.0), 0, true),
    ("shifted, STD 1 px, 1 view tolerated", Change::Shifted(1.0), 1, true),
    ("one bad mask", Change::BadMask, 0, true),
    ("one bad mask, not left out", Change::BadMask, 0, false),
];

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let value = |name: &str, default: &str| {
        let at = arguments.iter().position(|argument| argument == name);
        at.and_then(|at| arguments.get(at + 1)).map_or(default, String::as_str).to_owned()
    };
    let whole = |name: &str, default: &str| value(name, default).parse::<usize>().expect("a whole number");
    let tilts: Vec<f64> = value("--tilts", "0,8,16").split(',').map(|tilt| tilt.parse().expect("degrees")).collect();
    println!(
        "| seed | case | mesh to truth, median | mean | 95 % | truth to mesh, mean | 95 % | within 1 % | volume, mm^3 | left out | s |"
    );
    println!("|---:|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|");
    for seed in value("--seeds", "1").split(',') {
        let scan = Scan::render(seed.parse().expect("a seed"), whole("--width", "810"), whole("--pans", "18"), &tilts);
        for (name, change, tolerated, leave_out) in CASES {
            println!("| {seed} | {name} | {}", scan.row(change, tolerated, leave_out));
        }
    }
}

struct Scan {
    specimen: Specimen,
    cameras: Vec<PinholeCamera>,
    views: Vec<(Plane<u8>, Raster)>,
    /// Points of the true surface that the cameras see, and its longest side, mm.
    truth: Vec<Vector3<f64>>,
    size: f64,
}

impl Scan {
    fn render(seed: u64, width: usize, pans: usize, tilts: &[f64]) -> Self {
        let (rig, specimen) = (turntable::scan_rig(width, 9), Specimen::beetle(seed));
        let pan = |pan: usize| 360.0 * pan as f64 / pans as f64;
        let views = tilts.iter().flat_map(|&tilt_deg| (0..pans).map(move |at| (at, tilt_deg)));
        let views: Vec<ViewAngles> = views.map(|(at, tilt_deg)| ViewAngles { pan_deg: pan(at), tilt_deg }).collect();
        let camera = |angles: &ViewAngles| PinholeCamera {
            rotation: angles.rotation(),
            centre: angles.direction().map(|c| turntable::scan_radius(&rig) * c),
            focal_px: [rig.principal_distance(rig.reference) / rig.pixel_pitch_mm; 2],
            principal_point_px: rig.centre(),
            radial: [0.0; 2],
            size: [rig.width, rig.height],
        };
        let cameras: Vec<PinholeCamera> = views.iter().map(camera).collect();
        let picture = |&angles: &ViewAngles| {
            let truth = turntable::view(&rig, &specimen, angles).truth();
            (truth.mask, truth.sharp)
        };
        let pictures = views.par_iter().map(picture).collect();
        let (truth, size) = visible(&specimen, &cameras);
        Self { specimen, cameras, views: pictures, truth, size }
    }

    fn row(&self, change: Change, tolerated: usize, leave_out: bool) -> String {
        let (cameras, views) = self.changed(change);
        let options = HullOptions { tolerated, leave_out, mm_per_unit: Some(1.0), ..HullOptions::default() };
        let start = Instant::now();
        let hull = from_views(&cameras, &Views(views), &options, &NoControl).expect("a hull");
        let seconds = start.elapsed().as_secs_f64();
        let percent = 100.0 / self.size;
        let wrong = |point: &[f32; 3]| percent * distance(&self.specimen, point.map(f64::from).into()).abs();
        let [middle, wrong, wrong_95] = statistics(hull.mesh.positions.par_iter().map(wrong).collect());
        let nearest = Nearest::of(&hull.mesh);
        let missing: Vec<f64> = self.truth.par_iter().map(|point| percent * nearest.distance(point)).collect();
        let within = missing.iter().filter(|missing| **missing <= 1.0).count() as f64 / missing.len() as f64;
        let [_, missing, missing_95] = statistics(missing);
        format!(
            "{middle:.3} | {wrong:.2} | {wrong_95:.2} | {missing:.2} | {missing_95:.2} | {:.1} % | {:.0} | {} | {seconds:.1} |",
            100.0 * within,
            hull.summary.volume,
            hull.summary.contradicting_views.len()
        )
    }

    fn changed(&self, change: Change) -> (Vec<PinholeCamera>, Vec<(Plane<u8>, Raster)>) {
        let (mut cameras, mut views) = (self.cameras.clone(), self.views.clone());
        match change {
            Change::Nothing => {}
            Change::Half => {
                cameras = cameras.into_iter().step_by(2).collect();
                views = views.into_iter().step_by(2).collect();
            }
            Change::Shifted(sigma) => {
                for (at, coordinate) in cameras.iter_mut().flat_map(|camera| &mut camera.principal_point_px).enumerate()
                {
                    *coordinate += sigma * normal(at as u64);
                }
            }
            Change::BadMask => {
                let data = &mut views[5].0.data;
                let half = data.len() / 2;
                data[half..].fill(0);
            }
        }
        (cameras, views)
    }
}

/// About normal with standard deviation 1: a sum of twelve uniform numbers.
fn normal(seed: u64) -> f64 {
    let uniform =
        |at: u64| ((seed * 12 + at + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 11) as f64 / (1_u64 << 53) as f64;
    (0..12).map(uniform).sum::<f64>() - 6.0
}

/// Median, mean and 95 % quantile.
fn statistics(mut values: Vec<f64>) -> [f64; 3] {
    values.sort_by(f64::total_cmp);
    let quantile = |percent: usize| values[values.len() * percent / 100];
    [quantile(50), values.iter().sum::<f64>() / values.len() as f64, quantile(95)]
}

/// Distance from the surface of a specimen, negative inside; of an ellipsoid to first order.
fn distance(specimen: &Specimen, point: Vector3<f64>) -> f64 {
    let of_solid = |solid: &Solid| match solid {
        Solid::Ellipsoid { centre, turn, radii } => {
            let unit = turn.tr_mul(&(point - centre)).component_div(radii);
            let slope = unit.component_div(radii).norm() / unit.norm().max(1e-9);
            (unit.norm() - 1.0) / slope.max(1e-9)
        }
        Solid::Capsule { from, to, radius } => {
            let axis = to - from;
            let share = ((point - from).dot(&axis) / axis.norm_squared()).clamp(0.0, 1.0);
            (point - (from + share * axis)).norm() - radius
        }
    };
    specimen.limbs.iter().map(|limb| of_solid(&limb.solid)).fold(f64::INFINITY, f64::min)
}

/// The points of the true surface that enough cameras see, and the longest side of its box.
fn visible(specimen: &Specimen, cameras: &[PinholeCamera]) -> (Vec<Vector3<f64>>, f64) {
    let Surface { points, triangles } = Surface::of(specimen, EDGE_MM);
    let middles: Vec<(Vector3<f64>, Vector3<f64>)> = triangles
        .iter()
        .map(|triangle| triangle.map(|at| points[at as usize]))
        .map(|[a, b, c]| ((a + b + c) / 3.0, (b - a).cross(&(c - a)).normalize()))
        .collect();
    let sees = |point: &Vector3<f64>, normal: &Vector3<f64>, camera: &PinholeCamera| {
        let towards = (Vector3::from(camera.centre) - point).normalize();
        // steps as long as what is free around
        let mut along = 0.05;
        while along < 25.0 {
            let free = distance(specimen, point + along * towards);
            if free < 0.005 {
                return false;
            }
            along += free.max(0.02);
        }
        normal.dot(&towards) >= LEAST_COSINE
    };
    let is_seen = |(point, normal): &&(Vector3<f64>, Vector3<f64>)| {
        cameras.iter().filter(|camera| sees(point, normal, camera)).take(SEEN_BY).count() == SEEN_BY
    };
    let seen = middles.par_iter().filter(is_seen).map(|(point, _)| *point).collect();
    let side = |axis: usize| {
        let along = || middles.iter().map(|(point, _)| point[axis]);
        along().fold(f64::NEG_INFINITY, f64::max) - along().fold(f64::INFINITY, f64::min)
    };
    (seen, side(0).max(side(1)).max(side(2)))
}

/// The vertices of a mesh by boxes of space.
struct Nearest<'a>(HashMap<[i32; 3], Vec<&'a [f32; 3]>>);

impl<'a> Nearest<'a> {
    fn of(mesh: &'a Mesh) -> Self {
        let mut boxes = HashMap::<_, Vec<_>>::new();
        for position in &mesh.positions {
            boxes.entry(position.map(|value| (f64::from(value) / BOX_MM).floor() as i32)).or_default().push(position);
        }
        Self(boxes)
    }

    fn distance(&self, point: &Vector3<f64>) -> f64 {
        let home = [0, 1, 2].map(|axis| (point[axis] / BOX_MM).floor() as i32);
        let around = (-1..=1).flat_map(|x| (-1..=1).flat_map(move |y| (-1..=1).map(move |z| [x, y, z])));
        let near = around.filter_map(|step| self.0.get(&[0, 1, 2].map(|axis| home[axis] + step[axis])));
        let mut nearest = near.map(|vertices| to_nearest(point, vertices)).fold(f64::INFINITY, f64::min);
        if nearest <= BOX_MM {
            return nearest;
        }
        // far from the mesh: all boxes that may have a nearer vertex
        for (at, vertices) in &self.0 {
            let middle = Vector3::from(at.map(|index| BOX_MM * (f64::from(index) + 0.5)));
            if (point - middle).norm() - BOX_MM < nearest {
                nearest = nearest.min(to_nearest(point, vertices));
            }
        }
        nearest
    }
}

fn to_nearest(point: &Vector3<f64>, vertices: &[&[f32; 3]]) -> f64 {
    let distance = |vertex: &&[f32; 3]| (point - Vector3::from(vertex.map(f64::from))).norm();
    vertices.iter().map(distance).fold(f64::INFINITY, f64::min)
}
