//! Findings: sentences about problems, each with the slices concerned and what to do.

mod dots;
mod facts;
mod light;
mod rail;
mod target;

pub(super) use facts::Facts;
pub(super) use target::coverage;

use super::grade::Finding;

/// All findings, the most serious first.
pub(super) fn findings(facts: &Facts) -> Vec<Finding> {
    let ambiguous = dots::ambiguous_labels(facts).into_iter();
    let mut out: Vec<Finding> = ambiguous.chain(rail::findings(facts)).collect();
    out.extend(light::findings(facts));
    out.extend(dots::findings(facts));
    out.extend(target::findings(facts));
    // stable: findings of the same weight keep their order
    out.sort_by_key(|finding| std::cmp::Reverse(finding.allows));
    out
}
