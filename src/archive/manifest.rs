//! `manifest.json`: the order of the slices, told instead of guessed.

use serde::Deserialize;

use super::{
    ArchiveLimits,
    container::{Container, Member},
    invalid,
    layout::{Light, Picture, Sorted},
    listed, names,
};
use crate::model::{Fault, Warning};

/// Name of the file, in the root or in the folder around everything.
const FILE: &str = "manifest.json";

/// Largest manifest that is read.
const MAX_BYTES: u64 = 1 << 20;

/// The order of the slices.
#[derive(Debug, Deserialize)]
pub(super) struct Manifest {
    #[serde(default)]
    front: Vec<String>,
    #[serde(default)]
    back: Vec<String>,
}

/// The manifest among the files that are no pictures, when there is one. A `manifest.json` that speaks of neither
/// front nor back belongs to another program and is passed over.
pub(super) fn find(
    container: &Container,
    others: &[Member],
    wrapper: &str,
    limits: &ArchiveLimits,
    warnings: &mut Vec<Warning>,
) -> Result<Option<(Member, Manifest)>, Fault> {
    let inside = format!("{wrapper}{FILE}");
    let called = |member: &&Member, name: &str| member.name.eq_ignore_ascii_case(name);
    let found = others.iter().find(|m| called(m, &inside)).or_else(|| others.iter().find(|m| called(m, FILE)));
    let Some(member) = found else { return Ok(None) };
    let name = &member.name;
    if member.size > MAX_BYTES {
        return Err(invalid(name, format!("{name} is larger than 1 MiB, so it is not a list of slices")));
    }
    let bytes = container.read(member, limits)?;
    let text = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(&bytes);
    let advice = r#"it must look like {"front": ["a.jpg", "b.jpg"], "back": []}; or leave it out"#;
    let value: serde_json::Value = serde_json::from_slice(text)
        .map_err(|error| invalid(name, format!("{name} is not JSON ({error}); {advice}")))?;
    if value.get("front").is_none() && value.get("back").is_none() {
        let detail = format!("{name} names neither front nor back slices, so it was passed over");
        warnings.push(Warning::new("manifest_passed_over", detail));
        return Ok(None);
    }
    let manifest = serde_json::from_value(value)
        .map_err(|error| invalid(name, format!("{name} is not a list of slices ({error}); {advice}")))?;
    Ok(Some((member.clone(), manifest)))
}

impl Manifest {
    /// The pictures in the order of the manifest. Every picture must be named once, and every name must be there:
    /// a slice that is left out or counted twice would shift all others against the profile.
    pub(super) fn apply(self, pictures: Vec<Picture>) -> Result<Sorted, Fault> {
        let mut left: Vec<Option<Picture>> = pictures.into_iter().map(Some).collect();
        let front = take(&self.front, Light::Front, &mut left)?;
        let back = take(&self.back, Light::Back, &mut left)?;
        let unnamed: Vec<&str> = left.iter().flatten().map(|picture| picture.member.name.as_str()).collect();
        if let Some(first) = unnamed.first().copied() {
            let detail = format!("{FILE} does not name {}; name every picture of the zip", listed(unnamed));
            return Err(invalid(first, detail));
        }
        Ok(Sorted { front, back })
    }
}

fn take(named: &[String], light: Light, left: &mut [Option<Picture>]) -> Result<Vec<Member>, Fault> {
    let mut out = Vec::with_capacity(named.len());
    for name in named {
        let Some(label) = names::checked(name)? else {
            return Err(invalid(name, format!("{FILE} names {name:?}, which cannot be a slice")));
        };
        let found = left.iter_mut().find(|slot| slot.as_ref().is_some_and(|picture| is_called(picture, &label, light)));
        let Some(picture) = found.and_then(Option::take) else {
            let word = light.word();
            let detail = format!("{FILE} names the {word} slice {label}, which is not in the zip or was named before");
            return Err(invalid(&label, detail));
        };
        out.push(picture.member);
    }
    Ok(out)
}

/// True when `name` means this picture: its whole name, its name within the folder around everything, or its name
/// within the folder of the light.
fn is_called(picture: &Picture, name: &str, light: Light) -> bool {
    let same = |other: &str| other.to_lowercase() == name.to_lowercase();
    let within = picture.in_light_folder().is_some_and(|(folder, rest)| folder == light && same(rest));
    within || same(&picture.inner) || same(&picture.member.name)
}
