//! The zip of one view.

use std::{
    collections::HashSet,
    io::{Seek, Write},
};

use super::view::{Group, ScanView, ViewFiles};
use crate::{
    archive::{ArchiveLimits, container::Container, member_names, members::Member, slice_order},
    types::{Error, text::folded},
};

/// The name of the list of slices, which [`open`](crate::archive::open) reads.
pub(in crate::archive) const MANIFEST: &str = "manifest.json";

impl Group {
    /// What users see of this view.
    pub(super) fn view(&self, container: &Container) -> Result<ScanView, Error> {
        let shown = |members: &[Member]| members.iter().map(|member| member.name.clone()).collect();
        let folder = self.front.first().and_then(|m| m.name.rsplit_once('/')).map_or("", |(folder, _)| folder);
        let (front, back) = (named(&self.front, "front"), named(&self.back, "back"));
        let longest = front.iter().chain(&back).map(String::len).max().unwrap_or(0);
        let manifest = manifest(&front, &back).map_or(0, |bytes| bytes.len());
        let all = self.front.iter().chain(&self.back);
        Ok(ScanView {
            label: self.label.clone(),
            pan_deg: self.pan_deg,
            tilt_deg: self.tilt_deg,
            folder: folder.to_owned(),
            front: shown(&self.front),
            back: shown(&self.back),
            bytes: container.copied_bytes(all, longest as u64, manifest as u64)?,
        })
    }

    /// The members of the zip of this view.
    pub(super) fn files(&self) -> ViewFiles {
        let (front, back) = (named(&self.front, "front"), named(&self.back, "back"));
        let manifest = manifest(&front, &back);
        let all = front.into_iter().zip(&self.front).chain(back.into_iter().zip(&self.back));
        ViewFiles { members: all.map(|(name, member)| (name, member.index)).collect(), manifest }
    }

    /// Writes the zip of this view.
    pub(super) fn write(
        &self,
        container: &Container,
        limits: &ArchiveLimits,
        out: impl Write + Seek,
    ) -> Result<(), Error> {
        let (front, back) = (named(&self.front, "front"), named(&self.back, "back"));
        let manifest = manifest(&front, &back);
        let files: Vec<(&str, &[u8])> = manifest.iter().map(|bytes| (MANIFEST, bytes.as_slice())).collect();
        let all = front.into_iter().zip(&self.front).chain(back.into_iter().zip(&self.back));
        container.copy(all, &files, limits, out)
    }
}

/// The names of the slices of one light in the zip of the view: those of the files, in the folder of the light. When
/// slices from several folders have the same name, all begin with their number.
fn named(members: &[Member], folder: &str) -> Vec<String> {
    let mut stems = HashSet::new();
    let mut is_new = |member: &Member| stems.insert(folded(member_names::stem(member_names::base(&member.name))));
    let all_differ = members.iter().all(&mut is_new);
    let name = |(index, member): (usize, &Member)| {
        let base = member_names::base(&member.name);
        match all_differ {
            true => format!("{folder}/{base}"),
            false => format!("{folder}/{:05}_{base}", index + 1),
        }
    };
    members.iter().enumerate().map(name).collect()
}

/// The list of slices, when their order is not that of their names.
fn manifest(front: &[String], back: &[String]) -> Option<Vec<u8>> {
    let is_natural = |names: &[String]| {
        let mut sorted: Vec<&String> = names.iter().collect();
        slice_order::sort(&mut sorted, |name| name.as_str(), &mut Vec::new());
        sorted.into_iter().eq(names)
    };
    if is_natural(front) && is_natural(back) {
        return None;
    }
    let list = serde_json::json!({ "front": front, "back": back });
    Some(list.to_string().into_bytes())
}
