//! What is fused: of which size, how many slices, from which files.

use std::path::Path;

use pinstack::{
    archive::{ArchiveLimits, StackArchive, open},
    fusion::Plan,
    model::options::{GuidedParams, Method},
    synth::Rig,
};

/// The zips of a case. The back light is one of its own, so that the front's size can be told.
pub const FRONT: &str = "stack.zip";
pub const BACK: &str = "back.zip";

#[derive(Debug, Clone, Copy)]
pub struct Case {
    /// Texture everywhere, or an insect before a plain ground.
    pub dense: bool,
    pub width: usize,
    pub height: usize,
    pub sixteen: bool,
    pub slices: usize,
}

impl Case {
    pub fn rig(self) -> Rig {
        Rig::sized(self.width, self.height, self.slices)
    }

    pub fn plan(self) -> Plan {
        let rig = self.rig();
        Plan {
            width: self.width,
            height: self.height,
            homographies: (0..self.slices).map(|i| rig.homography(i)).collect(),
            gains: (0..self.slices).map(|i| rig.gain(i)).collect(),
            reference: rig.reference,
            method: method(),
            params: GuidedParams::default(),
            rail: None,
            near_first: Some(true),
        }
    }

    pub fn name(self) -> String {
        format!(
            "{}, {:.1} MP, {} slices of {} bits",
            if self.dense { "dense" } else { "typical" },
            (self.width * self.height) as f64 / 1e6,
            self.slices,
            if self.sixteen { 16 } else { 8 }
        )
    }

    /// The words by which a child is told which case it is about.
    pub fn words(self) -> [String; 5] {
        let flag = |flag: bool| usize::from(flag).to_string();
        [flag(self.dense), self.width.to_string(), self.height.to_string(), flag(self.sixteen), self.slices.to_string()]
    }

    pub fn of(words: &[String]) -> Self {
        let number = |i: usize| words[i].parse::<usize>().expect("a number");
        Self { dense: number(0) == 1, width: number(1), height: number(2), sixteen: number(3) == 1, slices: number(4) }
    }

    /// Fused as a job fuses the back light of such a stack.
    pub fn plan_of_back(self) -> Plan {
        let plan = self.plan();
        let method = if plan.method == Method::Guided { Method::Guided } else { Method::Pyramid };
        Plan { method, ..plan }
    }

    pub fn archive(self, folder: &Path) -> StackArchive {
        open(&folder.join(FRONT), &ArchiveLimits::default()).expect("our own zip can be read")
    }

    pub fn back(self, folder: &Path) -> StackArchive {
        open(&folder.join(BACK), &ArchiveLimits::default()).expect("our own zip can be read")
    }
}

/// METHOD=guided|pyramid|unveiled
fn method() -> Method {
    std::env::var("METHOD").map_or_else(
        |_| Method::default(),
        |name| serde_json::from_value(name.into()).expect("METHOD is guided, pyramid or unveiled"),
    )
}
