//! The order of the slices of one light: where its witnesses meet.
//!
//! | witness | known from | what it says |
//! |---|---|---|
//! | names | the directory | one order; or several, where a counter may have started again or points may separate |
//! | times of capture | the headers | which of these orders is right; that none is |
//! | pictures | their decoding | `slices_out_of_order` of the metrics; which of two orders is right ([`focus_prefers`]) |
//!
//! 1. A `manifest.json` gives the order. The other witnesses only cause warnings.
//! 2. Names with several readings: the first that the times do not contradict. A counter that seems to have started
//!    again although the times say otherwise is told: a TIFF may have the time of its export.
//! 3. Names with one reading that the times contradict: the order of the names, with a warning.
//!
//! Where a witness is overruled, the pictures are asked before a stack is fused: where they agree with it, the job
//! fails.
//!
//! [`focus_prefers`]: crate::quality::focus_prefers

use super::{copies, counter, member_names, natural_order, notation::Notation};
use crate::{
    imaging::codec::CaptureTime,
    types::{Warning, WarningCode},
};

/// An order that names tell.
#[derive(PartialEq)]
struct Reading {
    /// The indices of the slices.
    order: Vec<usize>,
    /// The place of the first slice after the counter started again.
    restarts_at: Option<usize>,
}

/// The orders that `names` may mean, the likeliest first.
fn readings(names: &[&str], notations: &[Notation]) -> Vec<Reading> {
    let is_copy = copies::are_copies(names);
    let (mut likely, mut possible) = (Vec::new(), Vec::new());
    for notation in notations {
        let order = natural_order::order(names, notation);
        let originals: Vec<usize> = order.iter().copied().filter(|&at| !is_copy[at]).collect();
        let restart = counter::restart(&originals.iter().map(|&at| names[at]).collect::<Vec<_>>(), notation);
        let restarted = restart.and_then(|restart| {
            let first = *originals.get(restart.start)?;
            let start = order.iter().position(|&at| at == first)?;
            let rotated =
                Reading { order: [&order[start..], &order[..start]].concat(), restarts_at: Some(order.len() - start) };
            Some((rotated, restart.is_certain))
        });
        let plain = Reading { order, restarts_at: None };
        match restarted {
            Some((rotated, true)) => likely.extend([rotated, plain]),
            Some((rotated, false)) => {
                likely.push(plain);
                possible.push(rotated);
            }
            None => likely.push(plain),
        }
    }
    likely.append(&mut possible);
    likely
}

/// How the numbers in `names` are written.
pub(super) fn notation(names: &[&str]) -> Notation {
    Notation::of(names.iter().map(|name| member_names::stem(name)))
}

/// Sorts slices by their names alone. Warns of a counter that started again and of copied files.
pub(super) fn sort<T: Clone>(items: &mut Vec<T>, name_of: impl Fn(&T) -> &str, warnings: &mut Vec<Warning>) {
    let names: Vec<&str> = items.iter().map(&name_of).collect();
    let Some(reading) = readings(&names, &[notation(&names)]).into_iter().next() else { return };
    warnings.extend(restarted(&names, &reading, false));
    warnings.extend(copied(&names));
    *items = reading.order.into_iter().map(|at| items[at].clone()).collect();
}

/// The order of the slices of one light, and what is to be said about it.
pub(super) struct Settled {
    /// The indices of the slices.
    pub order: Vec<usize>,
    /// The order of the witness that is overruled, as places in `order`.
    pub overruled: Option<Vec<usize>>,
    /// What users should know.
    pub warnings: Vec<Warning>,
}

/// Settles the order of the slices `names`, taken at `taken` as far as known. `is_listed`: they are in the order that
/// `manifest.json` gives.
pub(super) fn settle(names: &[String], taken: &[Option<CaptureTime>], is_listed: bool) -> Settled {
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let listed = || Reading { order: (0..names.len()).collect(), restarts_at: None };
    let readings = if is_listed {
        vec![listed()]
    } else {
        let own = notation(&names);
        readings(&names, &[own.clone(), own.with_other_points(), Notation::default()])
    };
    let fits = |reading: &&Reading| contradiction(&reading.order, taken).is_none();
    let Some(reading) = readings.iter().find(fits).or(readings.first()) else {
        return Settled { order: Vec::new(), overruled: None, warnings: Vec::new() };
    };
    let mut warnings = Vec::new();
    let likeliest = readings.first().filter(|first| first.restarts_at.is_some() && *first != reading);
    warnings.extend(likeliest.and_then(|first| restarted(&names, first, true)));
    warnings.extend(restarted(&names, reading, false));
    let contradiction = contradiction(&reading.order, taken);
    warnings.extend(contradiction.as_ref().map(|found| found.warning(&names, is_listed)));
    if !is_listed {
        warnings.extend(copied(&names));
    }
    let place = |at: &usize| reading.order.iter().position(|of_place| of_place == at).unwrap_or_default();
    let by_names = || likeliest.map(|first| first.order.iter().map(place).collect());
    let by_time = contradiction.filter(|_| !is_listed).and_then(|found| found.by_time(&reading.order, taken));
    Settled { order: reading.order.clone(), overruled: by_time.or_else(by_names), warnings }
}

/// A slice that was taken before another, although the order has them the other way round.
struct Contradiction {
    first: usize,
    second: usize,
    /// Most slices were taken after the one before them; otherwise before it.
    is_forward: bool,
}

impl Contradiction {
    /// The places in `order` by the time of capture; `None` unless all times are known.
    fn by_time(&self, order: &[usize], taken: &[Option<CaptureTime>]) -> Option<Vec<usize>> {
        let times: Vec<CaptureTime> =
            order.iter().map(|&at| taken.get(at).copied().flatten()).collect::<Option<_>>()?;
        let mut places: Vec<usize> = (0..times.len()).collect();
        places.sort_by(|&a, &b| if self.is_forward { times[a].cmp(&times[b]) } else { times[b].cmp(&times[a]) });
        Some(places)
    }

    fn warning(&self, names: &[&str], is_listed: bool) -> Warning {
        let advice = match is_listed {
            true => "the order is wrong, correct manifest.json",
            false => "the names are wrong, rename the files or list them in manifest.json",
        };
        let detail = format!(
            "the slices were not taken in the order in which they are used: by its EXIF time {} was taken before {}; if \
             {advice}",
            names[self.first], names[self.second]
        );
        Warning::new(WarningCode::OrderContradictsTimes, detail)
    }
}

/// How the times contradict an order. Equal times are normal: EXIF times are whole seconds. A stack that was taken from
/// its last slice to its first is in order.
fn contradiction(order: &[usize], taken: &[Option<CaptureTime>]) -> Option<Contradiction> {
    let known: Vec<(usize, CaptureTime)> =
        order.iter().filter_map(|&at| Some((at, taken.get(at).copied().flatten()?))).collect();
    let steps = || known.windows(2).map(|pair| (pair[0], pair[1]));
    let later = steps().filter(|(a, b)| b.1 > a.1).count();
    let earlier = steps().filter(|(a, b)| b.1 < a.1).count();
    let is_forward = later >= earlier;
    let (a, b) = steps().find(|(a, b)| if is_forward { b.1 < a.1 } else { b.1 > a.1 })?;
    let (first, second) = if is_forward { (b.0, a.0) } else { (a.0, b.0) };
    Some(Contradiction { first, second, is_forward })
}

/// The warning of a reading with a counter that started again. `is_overruled`: the times say otherwise.
fn restarted(names: &[&str], reading: &Reading, is_overruled: bool) -> Option<Warning> {
    let at = reading.restarts_at?;
    let name = |place: usize| reading.order.get(place).map_or("", |&at| names[at]);
    let (next, last) = (name(at), name(at.checked_sub(1)?));
    let detail = if is_overruled {
        format!(
            "by the names the camera's counter started again after {last}, but by the EXIF times {next} was taken \
             earlier: the times give the order; if they are wrong, list the slices in manifest.json"
        )
    } else {
        format!("the camera's counter started again within the stack: {next} is taken to follow {last}")
    };
    Some(Warning::new(WarningCode::CounterRollover, detail))
}

fn copied(names: &[&str]) -> Option<Warning> {
    let clause = copies::copied(names)?;
    let detail = format!("{clause}; check that the zip has each slice once, and nothing else");
    Some(Warning::new(WarningCode::CopiedFileName, detail))
}
