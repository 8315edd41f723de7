//! Sub-pixel centres of all dots of a slice at once.
//!
//! Turn by turn: the ground without the dots, the common shape of the dots, and per dot the small step
//! (Gauss-Newton with Huber weights) that explains best what its neighbours leave over.

use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

use super::field::Field;
use super::lattice::Label;
use super::shape::{Placed, Shape};
use super::working::{median, sample};
use crate::imaging::Plane;
use crate::model::{Cancelled, Control};

/// A dot that is looked for.
#[derive(Debug, Clone, Copy)]
pub struct Sought {
    /// Which.
    pub label: Label,
    /// Where it should be, px.
    pub at: [f64; 2],
    /// False for a place beside the grid where a dot may or may not be.
    pub known: bool,
}

/// A dot that was measured.
#[derive(Debug, Clone, Copy)]
pub struct Centre {
    /// Which.
    pub label: Label,
    /// Where, px.
    pub at: [f64; 2],
    /// Standard deviation of each coordinate, px.
    pub sigma: f64,
}

/// What a slice showed.
#[derive(Debug, Clone)]
pub struct Measured {
    /// The dots that can be relied on.
    pub centres: Vec<Centre>,
    /// How each looks.
    pub shape: Shape,
    /// The light.
    pub field: Field,
}

/// How much is done about it.
#[derive(Debug, Clone, Copy)]
pub struct Effort {
    /// Most rounds.
    pub rounds: usize,
    /// No more rounds once the longest step is shorter, px.
    pub enough: f64,
    /// True when places and light are nearly right from the start.
    pub settled: bool,
}

/// How far around a dot its pixels are looked at, in steps of the grid.
const WINDOW: f64 = 0.7;
/// How far the ink of a dot reaches, in steps of the grid.
const REACH: f64 = 0.85;
/// How much around a place where there may be a cut dot is left alone, in steps of the grid.
const CLOSED: f64 = 0.6;
/// Pixels that a centre is measured from at the least, where its window has as many.
const PLENTY: f64 = 1500.0;
/// Model errors that noise does not show (pixel response, light that is not a polynomial), px of the plane.
const FLOOR: f64 = 0.01;

/// Measures the dots `sought` in `plane`. `None` when they show nothing to measure.
///
/// # Errors
/// When the work is cancelled.
pub fn measure(
    plane: &Plane<f32>,
    field: Field,
    sought: &[Sought],
    pitch: f64,
    effort: Effort,
    control: &dyn Control,
) -> Result<Option<Measured>, Cancelled> {
    let mut field = field;
    let mut ink = field.ink(plane);
    let mut dots = starting_strengths(&ink, sought);
    let edge: Vec<bool> = sought.iter().map(|s| !s.known && at_edge(plane, s.at, pitch)).collect();
    let frame_open = open_pixels(plane, sought.iter().zip(&edge).filter(|(_, e)| **e).map(|(s, _)| s.at), pitch);
    let mut open = frame_open.clone();
    let mut shape = None;
    let mut steps = Vec::new();
    let settled = effort.settled;
    for round in 0..effort.rounds {
        control.check()?;
        let Some(measured) = Shape::measure(&ink, &open, &dots, REACH * pitch) else { return Ok(None) };
        let picture = measured.picture(&dots, plane.width, plane.height);
        let places: Vec<[f64; 2]> = dots.iter().filter(|d| d.strength > 0.5).map(|d| d.at).collect();
        if settled || round >= 3 {
            open = without_strangers(&ink, &picture, &frame_open, &measured);
        }
        field = field.refined(plane, &picture, &open, &places, 1.2 * pitch, if round < 2 && !settled { 2 } else { 4 });
        ink = field.ink(plane);
        steps = one_round(&ink, &picture, &open, &measured, &dots, pitch);
        let mut longest = 0.0_f64;
        for (((dot, step), sought), at_edge) in dots.iter_mut().zip(&steps).zip(sought).zip(&edge) {
            let Some(step) = step.filter(|_| !at_edge) else { continue };
            let far = step.shift[0].hypot(step.shift[1]);
            let cut = (0.15 * pitch / far.max(1e-12)).min(1.0);
            // a place where no dot is must not wander off to one
            let is_dot = sought.known || dot.strength > 0.5;
            if is_dot {
                let moved = [dot.at[0] + cut * step.shift[0], dot.at[1] + cut * step.shift[1]];
                let strayed = (moved[0] - sought.at[0]).hypot(moved[1] - sought.at[1]) > 0.35 * pitch;
                if !strayed {
                    dot.at = moved;
                    longest = longest.max(far);
                }
            }
            dot.strength = (dot.strength + step.strength).clamp(0.0, 2.0);
        }
        // an ordinary dot has strength 1, or shape and strengths could trade a factor
        let mut known: Vec<f64> = dots.iter().zip(sought).filter(|(_, s)| s.known).map(|(d, _)| d.strength).collect();
        let usual = median(&mut known).max(0.1);
        dots.iter_mut().for_each(|d| d.strength /= usual);
        shape = Some(measured);
        if round > if settled { 0 } else { 2 } && longest < effort.enough {
            break;
        }
    }
    let Some(shape) = shape else { return Ok(None) };
    let centres = reliable(plane, sought, &dots, &steps, &shape, pitch);
    Ok((!centres.is_empty()).then_some(Measured { centres, shape, field }))
}

/// Known dots begin with strength 1, places beside the grid with what the picture shows there.
fn starting_strengths(ink: &Plane<f32>, sought: &[Sought]) -> Vec<Placed> {
    let at = |s: &Sought| sample(ink, s.at).map_or(0.0, f64::from);
    let mut known: Vec<f64> = sought.iter().filter(|s| s.known).map(at).collect();
    let usual = median(&mut known);
    let strength = |s: &Sought| match at(s) / usual.max(1e-6) {
        _ if s.known => 1.0,
        share if share > 0.6 => share.min(1.2),
        _ => 0.0,
    };
    sought.iter().map(|s| Placed { at: s.at, strength: strength(s) }).collect()
}

/// True when a dot at `p` would be cut by the frame, so that nobody can tell whether there is one.
fn at_edge(plane: &Plane<f32>, p: [f64; 2], pitch: f64) -> bool {
    let margin = 0.5 * pitch;
    let inside = |v: f64, size: usize| v >= margin && v <= size as f64 - 1.0 - margin;
    !(inside(p[0], plane.width) && inside(p[1], plane.height))
}

/// 1 where the picture is used, 0 around places at the edge where there may be a cut dot or none.
fn open_pixels(plane: &Plane<f32>, edge: impl Iterator<Item = [f64; 2]>, pitch: f64) -> Plane<u8> {
    let mut open = Plane::filled(plane.width, plane.height, 1_u8);
    let reach = CLOSED * pitch;
    let range = |v: f64, size: usize| {
        let high = ((v + reach).floor() + 1.0).clamp(0.0, size as f64) as usize;
        (((v - reach).ceil().max(0.0)) as usize).min(high)..high
    };
    for p in edge {
        for y in range(p[1], plane.height) {
            for x in range(p[0], plane.width) {
                let (dx, dy) = (x as f64 - p[0], y as f64 - p[1]);
                if dx * dx + dy * dy <= reach * reach {
                    open.data[y * plane.width + x] = 0;
                }
            }
        }
    }
    open
}

/// `open` without the pixels that the dots do not explain at all: dust, scratches, lettering.
fn without_strangers(ink: &Plane<f32>, picture: &Plane<f32>, open: &Plane<u8>, shape: &Shape) -> Plane<u8> {
    let stride = (ink.data.len() / 50_000).max(1) | 1;
    let left_over = |k: usize| (ink.data[k] - picture.data[k]).abs();
    let mut sizes: Vec<f64> = (0..ink.data.len()).step_by(stride).map(|k| f64::from(left_over(k))).collect();
    let most = (8.0 * 1.4826 * median(&mut sizes)).max(0.5 * shape.top()) as f32;
    let data = open.data.iter().enumerate().map(|(k, o)| if left_over(k) > most { 0 } else { *o }).collect();
    Plane { width: open.width, height: open.height, data }
}

/// What one round says about one dot.
#[derive(Debug, Clone, Copy)]
struct Step {
    shift: [f64; 2],
    strength: f64,
    sigma: f64,
    misfit: f64,
    /// Share of its window that lies inside the picture.
    seen: f64,
}

fn one_round(
    ink: &Plane<f32>,
    picture: &Plane<f32>,
    open: &Plane<u8>,
    shape: &Shape,
    dots: &[Placed],
    pitch: f64,
) -> Vec<Option<Step>> {
    dots.par_iter().map(|dot| step_of(ink, picture, open, shape, dot, WINDOW * pitch)).collect()
}

fn step_of(
    ink: &Plane<f32>,
    picture: &Plane<f32>,
    open: &Plane<u8>,
    shape: &Shape,
    dot: &Placed,
    window: f64,
) -> Option<Step> {
    let range = |centre: f64, size: usize| {
        let low = (centre - window).ceil().max(0.0);
        let high = (centre + window).floor().min(size as f64 - 1.0);
        (low <= high).then_some(low as usize..=high as usize)
    };
    let (columns, rows) = (range(dot.at[0], ink.width)?, range(dot.at[1], ink.height)?);
    // with strength 0 the slopes are those of an ordinary dot
    let strength = if dot.strength > 0.05 { dot.strength } else { 1.0 };
    let mut pixels = Vec::new();
    // where a window is large, every second, third or fifth pixel of it, spread evenly, is plenty
    let (every, slant) = match std::f64::consts::PI * window * window / PLENTY {
        share if share < 2.0 => (1, 0),
        share if share < 3.0 => (2, 1),
        share if share < 5.0 => (3, 1),
        _ => (5, 2),
    };
    for y in rows {
        for x in (columns.start() + slant * y % every..=*columns.end()).step_by(every) {
            let (dx, dy) = (x as f64 - dot.at[0], y as f64 - dot.at[1]);
            let rho = (dx * dx + dy * dy).sqrt();
            if rho >= window || open.at(x, y) == 0 {
                continue;
            }
            let (value, slope) = shape.at(rho);
            let along = if rho > 1e-9 { -strength * slope / rho } else { 0.0 };
            let left_over = f64::from(ink.at(x, y) - picture.at(x, y));
            pixels.push((Vector3::new(along * dx, along * dy, value), left_over));
        }
    }
    if pixels.len() < 9 {
        return None;
    }
    let thin = pixels.len() / 400 + 1;
    let mut sizes: Vec<f64> = pixels.iter().step_by(thin).map(|(_, r)| r.abs()).collect();
    let spread = (1.4826 * median(&mut sizes)).max(1e-4);
    let (mut normal, mut right, mut square) = (Matrix3::zeros(), Vector3::zeros(), 0.0);
    for (slope, residual) in &pixels {
        let weight = (2.0 * spread / residual.abs().max(1e-12)).min(1.0);
        normal += weight * slope * slope.transpose();
        right += weight * residual * slope;
        square += residual * residual;
    }
    let inverse = normal.try_inverse()?;
    let step = inverse * right;
    let variance = square / (pixels.len() as f64 - 3.0);
    let sigma = (variance * 0.5 * (inverse[(0, 0)] + inverse[(1, 1)])).sqrt();
    if !step.iter().all(|v| v.is_finite()) || !sigma.is_finite() {
        return None;
    }
    Some(Step {
        shift: [step.x, step.y],
        strength: step.z,
        sigma: sigma.hypot(FLOOR),
        misfit: variance.sqrt(),
        seen: (pixels.len() * every) as f64 / (std::f64::consts::PI * window * window),
    })
}

/// The dots that are whole, as strong as the others, and explained by the common shape.
fn reliable(
    plane: &Plane<f32>,
    sought: &[Sought],
    dots: &[Placed],
    steps: &[Option<Step>],
    shape: &Shape,
    pitch: f64,
) -> Vec<Centre> {
    let known = || sought.iter().zip(dots).zip(steps).filter(|((s, _), _)| s.known);
    let mut misfits: Vec<f64> = known().filter_map(|(_, step)| step.map(|s| s.misfit)).collect();
    let mut strengths: Vec<f64> = known().map(|((_, dot), _)| dot.strength).collect();
    let (misfit, strength) = (median(&mut misfits), median(&mut strengths));
    let margin = shape.half_width() + 1.5;
    let whole = |p: [f64; 2]| {
        let inside = |v: f64, size: usize| v >= margin && v <= size as f64 - 1.0 - margin;
        inside(p[0], plane.width) && inside(p[1], plane.height)
    };
    let mut centres = Vec::new();
    for ((sought, dot), step) in sought.iter().zip(dots).zip(steps) {
        let Some(step) = step else { continue };
        let usual = (0.6..1.6).contains(&(dot.strength / strength.max(1e-6)));
        let settled = step.shift[0].hypot(step.shift[1]) < 0.05 * pitch;
        let clean = step.misfit < 3.0 * misfit + 0.01;
        let seen = step.seen > 0.7 && whole(dot.at);
        if usual && settled && clean && seen && step.sigma < 0.1 * pitch {
            centres.push(Centre { label: sought.label, at: dot.at, sigma: step.sigma });
        }
    }
    centres
}
