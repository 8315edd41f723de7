//! What is fused: of which size, how many slices, from which files.

use std::path::Path;

use pinstack_science::{
    archive::{ArchiveLimits, StackArchive, open},
    fusion::{Plan, SlicePlan},
    imaging::{Samples, Slices},
    synth::Rig,
    types::{
        fusion_options::{GuidedParams, Method},
        profile::ProfileInput,
    },
};

/// The zips of a case. The back light is one of its own, so that the front's size can be told.
pub const FRONT: &str = "stack.zip";
pub const BACK: &str = "back.zip";

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// An insect before a plain ground.
    Typical,
    /// Texture everywhere.
    Dense,
    /// Somebody's own, aligned already.
    Own,
    /// The stack of this place in [`PHOTOGRAPHED`].
    Photographed(usize),
}

/// The photographed stacks: the name of the folder with the pictures, and the profile that `photographed/align.py`
/// found.
pub const PHOTOGRAPHED: [(&str, &str); 5] = [
    ("newto12", include_str!("photographed/newto12.json")),
    ("pcb_depth10", include_str!("photographed/pcb_depth10.json")),
    ("pcb7", include_str!("photographed/pcb7.json")),
    ("flies9", include_str!("photographed/flies9.json")),
    ("coffee6", include_str!("photographed/coffee6.json")),
];

fn profile(stack: usize) -> ProfileInput {
    serde_json::from_str(PHOTOGRAPHED[stack].1).expect("a profile beside the bench")
}

#[derive(Debug, Clone, Copy)]
pub struct Case {
    pub kind: Kind,
    pub width: usize,
    pub height: usize,
    pub sixteen: bool,
    pub slices: usize,
}

impl Case {
    pub fn rig(self) -> Rig {
        Rig::sized(self.width, self.height, self.slices)
    }

    /// Whether there is a rendered back light.
    pub fn has_back(self) -> bool {
        matches!(self.kind, Kind::Typical | Kind::Dense)
    }

    /// The case of the zip `stack`, which has one light.
    pub fn of_own(stack: &Path) -> Self {
        let archive =
            open(stack, &ArchiveLimits::default()).unwrap_or_else(|fault| panic!("{}: {fault}", stack.display()));
        let first = archive.front().load(0).unwrap_or_else(|fault| panic!("{}: {fault}", stack.display()));
        assert!(first.channels == 3, "{}: the bench takes stacks in colour, and this one is grey", stack.display());
        let sixteen = matches!(first.samples, Samples::Sixteen(_));
        Self { kind: Kind::Own, width: first.width, height: first.height, sixteen, slices: archive.front().count() }
    }

    /// The case of a photographed stack.
    pub fn photographed(stack: usize) -> Self {
        let profile = profile(stack);
        let (width, height) = (profile.image_width as usize, profile.image_height as usize);
        let (kind, slices) = (Kind::Photographed(stack), profile.homographies.len());
        Self { kind, width, height, sixteen: false, slices }
    }

    pub fn plan(self) -> Plan {
        if let Kind::Photographed(stack) = self.kind {
            return Plan::from_profile(&profile(stack), method(), GuidedParams::default());
        }
        if self.kind == Kind::Own {
            let aligned = Plan::aligned(self.width, self.height, self.slices);
            return Plan { method: method(), near_first: Some(true), ..aligned };
        }
        let rig = self.rig();
        Plan {
            width: self.width,
            height: self.height,
            slices: (0..self.slices)
                .map(|i| SlicePlan { homography: rig.homography(i), gain: rig.gain(i), rail_mm: None })
                .collect(),
            reference: rig.reference,
            method: method(),
            params: GuidedParams::default(),
            near_first: Some(true),
            height_map: None,
            distortion: None,
            lateral_colour: None,
        }
    }

    pub fn name(self) -> String {
        format!(
            "{}, {:.1} MP, {} slices of {} bits",
            match self.kind {
                Kind::Typical => "typical",
                Kind::Dense => "dense",
                Kind::Own => "own",
                Kind::Photographed(stack) => PHOTOGRAPHED[stack].0,
            },
            (self.width * self.height) as f64 / 1e6,
            self.slices,
            if self.sixteen { 16 } else { 8 }
        )
    }

    /// The words by which a child is told which case it is about.
    pub fn words(self) -> [String; 5] {
        let kind = match self.kind {
            Kind::Typical => 0,
            Kind::Dense => 1,
            Kind::Own => 2,
            Kind::Photographed(stack) => 3 + stack,
        };
        [kind, self.width, self.height, usize::from(self.sixteen), self.slices].map(|word| word.to_string())
    }

    pub fn of(words: &[String]) -> Self {
        let number = |i: usize| words[i].parse::<usize>().expect("a number");
        let kind = match number(0) {
            0 => Kind::Typical,
            1 => Kind::Dense,
            2 => Kind::Own,
            stack => Kind::Photographed(stack - 3),
        };
        Self { kind, width: number(1), height: number(2), sixteen: number(3) == 1, slices: number(4) }
    }

    /// Fused as a job fuses the back light of such a stack.
    pub fn plan_of_back(self) -> Plan {
        let plan = self.plan();
        Plan { method: plan.method.for_back_light(), ..plan }
    }

    pub fn archive(self, folder: &Path) -> StackArchive {
        open(&folder.join(FRONT), &ArchiveLimits::default()).expect("our own zip can be read")
    }

    pub fn back(self, folder: &Path) -> StackArchive {
        open(&folder.join(BACK), &ArchiveLimits::default()).expect("our own zip can be read")
    }
}

/// That of `METHOD=NAME`.
fn method() -> Method {
    std::env::var("METHOD").map_or_else(
        |_| Method::default(),
        |name| serde_json::from_value(name.into()).expect("METHOD is the name of a method"),
    )
}
