//! Column sums that slide down the image: rows enter and leave.

use std::ops::Range;

/// Sums of `I`, `I p`, `p` and `I^2` per column.
#[derive(Debug, Default)]
pub(super) struct Columns {
    pub(super) i: Vec<u32>,
    pub(super) ip: Vec<u32>,
    pub(super) p: Vec<u32>,
    pub(super) ii: Vec<u64>,
}

impl Columns {
    pub(super) fn clear(&mut self, length: usize) {
        for sums in [&mut self.i, &mut self.ip, &mut self.p] {
            sums.clear();
            sums.resize(length, 0);
        }
        self.ii.clear();
        self.ii.resize(length, 0);
    }
}

impl Columns {
    /// The sums of the columns `span` of the taps.
    pub(super) fn part(&mut self, left: usize, span: Range<usize>) -> Part<'_> {
        let columns = left + span.start..left + span.end;
        Part {
            i: &mut self.i[columns.clone()],
            ip: &mut self.ip[columns.clone()],
            p: &mut self.p[columns.clone()],
            ii: &mut self.ii[columns],
        }
    }
}

pub(super) struct Part<'a> {
    pub(super) i: &'a mut [u32],
    pub(super) ip: &'a mut [u32],
    pub(super) p: &'a mut [u32],
    pub(super) ii: &'a mut [u64],
}

#[inline(always)]
pub(super) fn exchange(part: Part<'_>, enters: (&[u16], &[bool]), leaves: (&[u16], &[bool])) {
    let Part { i, ip, p, ii } = part;
    sum_rows(i, ip, p, enters, leaves);
    square_rows(ii, enters.0, leaves.0);
}

#[inline(always)]
#[allow(clippy::needless_range_loop, reason = "one index for several arrays")]
fn sum_rows(i: &mut [u32], ip: &mut [u32], p: &mut [u32], enters: (&[u16], &[bool]), leaves: (&[u16], &[bool])) {
    let n = i.len();
    let (ip, p) = (&mut ip[..n], &mut p[..n]);
    let (enters, enters_in, leaves, leaves_in) = (&enters.0[..n], &enters.1[..n], &leaves.0[..n], &leaves.1[..n]);
    for x in 0..n {
        let (e, l) = (u32::from(enters[x]), u32::from(leaves[x]));
        let (e_in, l_in) = (u32::from(enters_in[x]), u32::from(leaves_in[x]));
        i[x] = i[x].wrapping_add(e).wrapping_sub(l);
        p[x] = p[x].wrapping_add(e_in).wrapping_sub(l_in);
        let (e, l) = (e & 0u32.wrapping_sub(e_in), l & 0u32.wrapping_sub(l_in));
        ip[x] = ip[x].wrapping_add(e).wrapping_sub(l);
    }
}

#[inline(always)]
fn square_rows(ii: &mut [u64], enters: &[u16], leaves: &[u16]) {
    for ((ii, &e), &l) in ii.iter_mut().zip(enters).zip(leaves) {
        let (e, l) = (u64::from(e), u64::from(l));
        *ii = ii.wrapping_add(e * e).wrapping_sub(l * l);
    }
}

#[inline(always)]
pub(super) fn add<const ENTERS: bool>(part: Part<'_>, grey: &[u16], map: &[bool]) {
    let sign = if ENTERS { 1u32 } else { u32::MAX };
    let sums = part.i.iter_mut().zip(part.ip).zip(part.p);
    for (((i, ip), p), (&grey, &inside)) in sums.zip(grey.iter().zip(map)) {
        let (grey, inside) = (u32::from(grey), u32::from(inside));
        *i = i.wrapping_add(grey.wrapping_mul(sign));
        *ip = ip.wrapping_add((grey & 0u32.wrapping_sub(inside)).wrapping_mul(sign));
        *p = p.wrapping_add(inside.wrapping_mul(sign));
    }
    for (ii, &grey) in part.ii.iter_mut().zip(grey) {
        let square = u64::from(grey) * u64::from(grey);
        *ii = if ENTERS { ii.wrapping_add(square) } else { ii.wrapping_sub(square) };
    }
}

#[inline(always)]
pub(super) fn exchange_row(sums: &mut [u32], enters: &[u32], leaves: &[u32]) {
    for ((sum, &enters), &leaves) in sums.iter_mut().zip(enters).zip(leaves) {
        *sum = sum.wrapping_add(enters).wrapping_sub(leaves);
    }
}
