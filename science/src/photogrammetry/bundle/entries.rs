//! The files of a bundle, and what the layouts write them from.

use super::{
    camera::Camera,
    pose::Pose,
    types::{BundleScan, BundleView},
};

/// A file of a bundle.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    /// Name with `/` between folders.
    pub path: String,
    /// Its bytes.
    pub content: Content,
}

/// The bytes of a file.
#[derive(Debug, Clone, PartialEq)]
pub enum Content {
    /// This text.
    Text(String),
    /// The image of the view with this index.
    Image(usize),
    /// The mask of the view with this index.
    Mask(usize),
}

/// What the layouts are made from.
pub(super) struct Bundle<'a> {
    pub scan: &'a BundleScan,
    /// `None` when the principal distance is unknown.
    pub camera: Option<Camera>,
    /// One per view; `None` unless every view has pan and tilt.
    pub poses: Option<Vec<Pose>>,
}

impl Bundle<'_> {
    /// Images under `images/`, and masks where `mask` places them.
    pub(super) fn pictures(&self, mask: impl Fn(&BundleView) -> String) -> Vec<Entry> {
        let views = self.scan.views.iter().enumerate();
        let images = views
            .clone()
            .map(|(at, view)| Entry { path: format!("images/{}", view.file()), content: Content::Image(at) });
        let masks = views.filter(|(_, view)| view.has_mask);
        let masks = masks.map(|(at, view)| Entry { path: mask(view), content: Content::Mask(at) });
        images.chain(masks).collect()
    }

    /// Whether a view has a mask.
    pub(super) fn has_masks(&self) -> bool {
        self.scan.views.iter().any(|view| view.has_mask)
    }

    /// How many views have no mask.
    pub(super) fn without_mask(&self) -> usize {
        self.scan.views.iter().filter(|view| !view.has_mask).count()
    }

    /// Views with their poses.
    pub(super) fn posed(&self) -> impl Iterator<Item = (&BundleView, &Pose)> {
        self.scan.views.iter().zip(self.poses.iter().flatten())
    }
}

pub(super) fn text(path: &str, text: String) -> Entry {
    Entry { path: path.to_owned(), content: Content::Text(text) }
}

pub(super) fn json(path: &str, value: &serde_json::Value) -> Entry {
    // a value without maps of other keys than text can always be written
    text(path, serde_json::to_string_pretty(value).unwrap_or_default() + "\n")
}
