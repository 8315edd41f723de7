//! `manifest.json`: the order of the slices, given explicitly.

use std::collections::{BTreeMap, HashMap};

use serde::Deserialize;

use super::{
    container::Container,
    further_lights,
    light::Light,
    limits::ArchiveLimits,
    member_names::{self, InvalidName},
    members::{Member, Picture, SortedSlices},
    messages::{invalid, listed},
};
use crate::types::{Error, Warning, WarningCode, text::folded};

/// Name of the file, in the root or in the folder that encloses everything.
const FILE: &str = "manifest.json";

/// Maximum size of a manifest, bytes.
const MAX_BYTES: u64 = 1 << 20;

/// The order of the slices.
#[derive(Debug, Deserialize)]
pub(super) struct Manifest {
    #[serde(default)]
    front: Vec<String>,
    #[serde(default)]
    back: Vec<String>,
    #[serde(default)]
    lights: BTreeMap<String, Vec<String>>,
}

/// The manifest, if there is one among the files that are not pictures. A `manifest.json` with neither `front` nor
/// `back` belongs to another program and is ignored, with a warning.
pub(super) fn find(
    container: &Container,
    others: &[Member],
    wrapper: &str,
    limits: &ArchiveLimits,
    warnings: &mut Vec<Warning>,
) -> Result<Option<(Member, Manifest)>, Error> {
    let inside = format!("{wrapper}{FILE}");
    let called = |member: &&Member, name: &str| folded(&member.name) == folded(name);
    let found = others.iter().find(|m| called(m, &inside)).or_else(|| others.iter().find(|m| called(m, FILE)));
    let Some(member) = found else { return Ok(None) };
    let name = &member.name;
    if member.size > MAX_BYTES {
        return Err(invalid(
            name,
            format!("{name} is larger than 1 MiB, the maximum for a list of slices; shorten or omit it"),
        ));
    }
    let bytes = container.read(member, limits)?;
    let advice = r#"it must look like {"front": ["a.jpg", "b.jpg"], "back": []}; or omit the file"#;
    let value = json(name, &bytes, advice)?;
    if value.get("front").is_none() && value.get("back").is_none() {
        let detail = format!("{name} has neither \"front\" nor \"back\", so it was ignored");
        warnings.push(Warning::new(WarningCode::ManifestPassedOver, detail));
        return Ok(None);
    }
    let manifest = serde_json::from_value(value).map_err(|error| {
        invalid(name, format!("{name} is not a list of slices ({error}); {advice}")).caused_by(error)
    })?;
    Ok(Some((member.clone(), manifest)))
}

/// The manifest of one stack in `bytes`; `None` where they are something else, such as the list of a scan.
pub(super) fn of_stack(bytes: &[u8]) -> Option<Manifest> {
    let value = json(FILE, bytes, "").ok()?;
    let is_one = value.get("front").is_some() || value.get("back").is_some();
    serde_json::from_value(value).ok().filter(|_| is_one)
}

/// The JSON of the manifest `name`, which may begin with a byte order mark.
pub(super) fn json(name: &str, bytes: &[u8], advice: &str) -> Result<serde_json::Value, Error> {
    let text = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes);
    serde_json::from_slice(text)
        .map_err(|error| invalid(name, format!("{name} is not JSON ({error}); {advice}")).caused_by(error))
}

impl Manifest {
    /// The pictures in the order of the manifest. Every picture must be named once, and every name must exist: an
    /// omitted or repeated slice would shift all others against the profile.
    pub(super) fn apply(self, pictures: Vec<Picture>) -> Result<SortedSlices, Error> {
        let mut pictures = Pictures::new(pictures);
        let front = pictures.take(&self.front, Folder::Of(Light::Front))?;
        let back = pictures.take(&self.back, Folder::Of(Light::Back))?;
        let mut lights = Vec::new();
        for (light, named) in &self.lights {
            further_lights::require_name(light).map_err(|detail| invalid(FILE, detail))?;
            lights.push((light.clone(), pictures.take(named, Folder::Named(light))?));
        }
        further_lights::refuse_many(&lights)?;
        let unnamed: Vec<&str> = pictures.left.iter().flatten().map(|picture| picture.member.name.as_str()).collect();
        if let Some(first) = unnamed.first().copied() {
            let detail = format!("{FILE} omits {}; list every picture of the zip", listed(unnamed));
            return Err(invalid(first, detail));
        }
        Ok(SortedSlices { front, back, lights, moved: Vec::new(), is_listed: true })
    }
}

/// The error for a name in the manifest that no member of a zip can have.
fn invalid_name(InvalidName { shown, reason }: InvalidName) -> Error {
    invalid(FILE, format!("{FILE} lists {shown:?}: the name {}; correct the list", reason.clause()))
}

/// The folder that the names of one light are relative to.
#[derive(Clone, Copy)]
enum Folder<'a> {
    /// That of front or back light, by any of its words.
    Of(Light),
    /// That of a further light.
    Named(&'a str),
}

/// Pictures that are not yet named, with an index by lower-case name.
struct Pictures {
    left: Vec<Option<Picture>>,
    /// Full names, and names without the enclosing folders.
    by_name: HashMap<String, Vec<usize>>,
    /// Names within the folder of their light.
    by_light: HashMap<(Light, String), Vec<usize>>,
}

impl Pictures {
    fn new(pictures: Vec<Picture>) -> Self {
        let mut by_name: HashMap<String, Vec<usize>> = HashMap::new();
        let mut by_light: HashMap<(Light, String), Vec<usize>> = HashMap::new();
        for (at, picture) in pictures.iter().enumerate() {
            by_name.entry(folded(&picture.member.name)).or_default().push(at);
            by_name.entry(folded(&picture.inner)).or_default().push(at);
            if let Some((light, rest)) = picture.in_light_folder() {
                by_light.entry((light, folded(rest))).or_default().push(at);
            }
        }
        Self { left: pictures.into_iter().map(Some).collect(), by_name, by_light }
    }

    /// Removes the slices of one light, in the order in which `named` lists them.
    fn take(&mut self, named: &[String], folder: Folder<'_>) -> Result<Vec<Member>, Error> {
        let mut out = Vec::new();
        for name in named {
            let Some(label) = member_names::label(name).map_err(invalid_name)? else {
                return Err(invalid(
                    name,
                    format!("{FILE} lists {name:?}, which cannot be a slice; list the pictures of the zip only"),
                ));
            };
            let small = folded(&label);
            let in_folder = match folder {
                Folder::Of(light) => self.by_light.get(&(light, small.clone())),
                Folder::Named(name) => self.by_name.get(&folded(&format!("{name}/{label}"))),
            };
            let called = self.by_name.get(&small).into_iter().chain(in_folder);
            let free = called.flatten().copied().filter(|&at| self.left.get(at).is_some_and(Option::is_some)).min();
            let Some(picture) = free.and_then(|at| self.left.get_mut(at)?.take()) else {
                let word = match folder {
                    Folder::Of(light) => light.word(),
                    Folder::Named(name) => name,
                };
                let detail = format!(
                    "{FILE} lists the {word} slice {label}, which is not in the zip or was listed before; correct \
                     the list, or omit it"
                );
                return Err(invalid(&label, detail));
            };
            out.push(picture.member);
        }
        Ok(out)
    }
}
