//! How names would be read as one stack, or as the slices of a dot target: for a page that shows it before it sends.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{
    layout, manifest,
    members::{Member, SortedSlices},
    numbering_gaps, slice_counts,
};
use crate::types::stack_layout::{FurtherLight, StackLayout};

/// One stack as names tell it.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct NamedStack {
    /// Names of the front-light slices, in order. Empty if the names are refused.
    pub front: Vec<String>,
    /// Names of the back-light slices, in order.
    pub back: Vec<String>,
    /// Further lights.
    pub lights: Vec<FurtherLight>,
    /// Names of the pictures of the moved target of a calibration.
    pub moved: Vec<String>,
    /// The gaps in the numbering of the front-light slices, as a clause; null when there are none.
    pub gaps: Option<String>,
    /// Why it cannot be sent as one stack, as far as names and numbers tell; null when nothing is wrong.
    pub problem: Option<String>,
}

impl NamedStack {
    /// The stack of `pictures`. `listed` is the content of a `manifest.json` among their files. The times of capture,
    /// which only the pictures tell, may correct the order.
    pub(super) fn of(pictures: Vec<Member>, listed: Option<&[u8]>) -> Self {
        let sorted = match layout::of_pictures(pictures, listed.and_then(manifest::of_stack)) {
            Ok(sorted) => sorted,
            Err(error) => return Self { problem: Some(error.detail), ..Self::default() },
        };
        let SortedSlices { front, back, lights, moved, is_listed } = sorted;
        let names = |members: Vec<Member>| members.into_iter().map(|member| member.name).collect::<Vec<_>>();
        let lights = lights.into_iter().map(|(name, slices)| FurtherLight { name, slices: names(slices) });
        let layout = StackLayout {
            front: names(front),
            back: names(back),
            lights: lights.collect(),
            moved: names(moved),
            // only pictures tell the rest
            width: 0,
            height: 0,
            bit_depth: 8,
            channels: 1,
            orientation: 1,
            largest_file_bytes: 0,
        };
        let problem = slice_counts::refuse(&layout).err().map(|error| error.detail);
        let gaps = numbering_gaps::skipped(&layout.front).filter(|_| !is_listed);
        let StackLayout { front, back, lights, moved, .. } = layout;
        Self { front, back, lights, moved, gaps, problem }
    }
}
