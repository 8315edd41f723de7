//! The verdict on a fused stack: use it, look at it, or do not use it.
//!
//! In go the codes of its warnings and notes; out come the verdict, and for each code what happened, what to do, and
//! what the service itself can do, in words for people. [`table`] has one row per code. Pages, API, clients and command
//! line take verdicts and words from here, so that they agree.

mod table;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use pinstack_science::types::{
    Warning, WarningCode,
    metrics::{Finding, Severity},
};

/// The verdict on a result, the mildest first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Nothing was found that affects the result.
    Use,
    /// A part of the result may be affected: a person should look at it before it is used.
    Look,
    /// The result is wrong, or shows something else than was meant.
    DoNotUse,
}

impl Verdict {
    /// All verdicts, the mildest first.
    pub const ALL: [Self; 3] = [Self::Use, Self::Look, Self::DoNotUse];

    /// Its name in the API.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Use => "use",
            Self::Look => "look",
            Self::DoNotUse => "do_not_use",
        }
    }

    /// The words for people.
    pub fn words(self) -> &'static str {
        match self {
            Self::Use => "Use it",
            Self::Look => "Look at it",
            Self::DoNotUse => "Do not use it",
        }
    }
}

/// What the service can do about a finding.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Remedy {
    /// Fuse the slices again in the other order.
    FuseInOtherOrder,
    /// Fuse again with the current revision of the profile.
    FuseWithCurrentRevision,
    /// Fuse again, and cut off what some slices do not cover.
    FuseCropped,
    /// Fuse again without a mask.
    FuseWithoutMask,
    /// Fuse again by the pyramid method, which needs no order of depth.
    FuseByPyramid,
    /// Fuse again by the guided method, to which the parameters belong.
    FuseGuided,
    /// Fuse again with the number of bits that the samples have.
    FuseWithBits,
    /// Send pictures of a dot target.
    Calibrate,
    /// Delete the stack, so that its scan counts the view as missing.
    DeleteView,
}

/// What is said of a code.
#[derive(Debug, Clone, Copy)]
pub struct Explanation {
    /// The verdict on a stack for which it is the worst finding.
    pub verdict: Verdict,
    /// What happened, a phrase.
    pub title: &'static str,
    /// What to do, one or two sentences.
    pub cure: &'static str,
    /// What the service can do.
    pub remedies: &'static [Remedy],
}

/// A warning or note of a stack, explained.
#[derive(Debug, Clone)]
pub struct Explained<'a> {
    /// Its code.
    pub code: &'a WarningCode,
    /// The sentence with the figures.
    pub detail: &'a str,
    /// 0-based indices of the slices concerned; empty if all are.
    pub slices: &'a [u32],
    /// What is said of the code.
    pub explanation: Explanation,
}

/// What is said of a code. A code of another version, or one that is not of stacks, should be looked at.
pub fn explanation(code: &WarningCode) -> Explanation {
    table::row(code).unwrap_or(Explanation {
        verdict: Verdict::Look,
        title: "Something else was noticed",
        cure: "Read the sentence below.",
        remedies: &[],
    })
}

/// The verdict on a stack with these warnings.
pub fn verdict(warnings: &[Warning]) -> Verdict {
    warnings.iter().map(|warning| explanation(&warning.code).verdict).max().unwrap_or(Verdict::Use)
}

/// The warnings and notes of a stack, the worst first. A note does not affect the result, whatever its code.
pub fn explained<'a>(warnings: &'a [Warning], findings: &'a [Finding]) -> Vec<Explained<'a>> {
    let slices = |warning: &Warning| {
        let same = |finding: &&Finding| finding.code == warning.code && finding.detail == warning.detail;
        findings.iter().find(same).map_or(&[][..], |finding| &finding.slices)
    };
    let of_warning = |warning: &'a Warning| Explained {
        code: &warning.code,
        detail: &warning.detail,
        slices: slices(warning),
        explanation: explanation(&warning.code),
    };
    let of_note = |note: &'a Finding| Explained {
        code: &note.code,
        detail: &note.detail,
        slices: &note.slices,
        explanation: Explanation { verdict: Verdict::Use, ..explanation(&note.code) },
    };
    let notes = findings.iter().filter(|finding| finding.severity == Severity::Note);
    let mut all: Vec<_> = warnings.iter().map(of_warning).chain(notes.map(of_note)).collect();
    all.sort_by_key(|one| std::cmp::Reverse(one.explanation.verdict));
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_worst_warning_decides_and_stands_first() {
        let warning = |code: WarningCode| Warning::new(code, "x");
        let warnings = [warning(WarningCode::Clipped), warning(WarningCode::SlicesReversed)];
        assert_eq!(verdict(&warnings), Verdict::DoNotUse);
        assert_eq!(verdict(&warnings[..1]), Verdict::Look);
        assert_eq!(verdict(&[]), Verdict::Use);
        assert_eq!(verdict(&[warning(WarningCode::Other("of_another_version".into()))]), Verdict::Look);
        let note = |code, slices: &[u32]| Finding {
            code,
            severity: Severity::Note,
            detail: "y".into(),
            slices: slices.to_vec(),
        };
        let all = [note(WarningCode::Halos, &[2])];
        let codes: Vec<&str> = explained(&warnings, &all).iter().map(|one| one.code.as_str()).collect();
        assert_eq!(codes, ["slices_reversed", "clipped", "halos"]);
    }

    #[test]
    fn the_documentation_lists_each_code_beside_its_verdict() {
        let page = include_str!("../../docs/FINDINGS.md");
        for verdict in Verdict::ALL {
            let beginning = format!("| `{}` |", verdict.as_str());
            let line = page.lines().find(|line| line.starts_with(&beginning)).unwrap_or_else(|| panic!("{beginning}"));
            let listed: Vec<&str> = line.split('`').skip(3).step_by(2).collect();
            let known = WarningCode::ALL.iter().filter(|code| table::row(code).is_some_and(|r| r.verdict == verdict));
            let known: Vec<&str> = known.map(WarningCode::as_str).collect();
            let row = format!("`{}`", known.join("`, `"));
            assert_eq!(listed, known, "the row of {} in docs/FINDINGS.md should list {row}", verdict.as_str());
        }
    }
}
