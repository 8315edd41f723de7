//! Rendered stacks, complete or slice by slice.

use std::sync::Arc;

use super::Rig;
use super::scene::Scene;
use super::sensor::Light;
use super::stage::{Stage, Truth};
use super::target::{DotTarget, render_target};
use crate::imaging::{Raster, Slices};
use crate::types::{Error, ErrorKind};

/// Slice `i` of `scene`. Samples the scene for each call; use a [`Stage`] for more than one slice.
pub fn render(rig: &Rig, scene: &Scene, light: Light, i: usize) -> Raster {
    Stage::new(rig, scene).render(light, i)
}

/// The ground truth of `scene` for `rig`.
pub fn truth(rig: &Rig, scene: &Scene) -> Truth {
    Stage::new(rig, scene).truth()
}

/// All slices of `target`, in memory.
pub fn target_stack(rig: &Rig, target: &DotTarget) -> Vec<Raster> {
    (0..rig.slices()).map(|i| render_target(rig, target, i)).collect()
}

/// A stack whose slices are rendered on demand.
#[derive(Debug, Clone)]
pub struct Rendered {
    subject: Subject,
    names: Vec<String>,
}

#[derive(Debug, Clone)]
enum Subject {
    Scene(Arc<Stage>, Light),
    Target(Arc<(Rig, DotTarget)>),
}

impl Rendered {
    /// The slices of a scene.
    ///
    /// # Example
    /// ```
    /// use std::sync::Arc;
    ///
    /// use pinstack_science::{imaging::Slices, synth::{Light, Rendered, Rig, Scene, Stage}};
    ///
    /// let stage = Arc::new(Stage::new(&Rig::sized(96, 64, 3), &Scene::insect(1)));
    /// let (slices, truth) = (Rendered::scene(stage.clone(), Light::Front), stage.truth());
    /// assert_eq!((slices.count(), slices.load(0)?.width), (3, 96));
    /// assert!(truth.mask.data.contains(&255) && truth.mask.data.contains(&0));
    /// # Ok::<(), pinstack_science::types::Error>(())
    /// ```
    pub fn scene(stage: Arc<Stage>, light: Light) -> Self {
        let kind = match light {
            Light::Front => "front",
            Light::Back => "back",
        };
        let names = names(kind, stage.rig().slices());
        Self { subject: Subject::Scene(stage, light), names }
    }

    /// The slices of a dot target.
    pub fn target(rig: &Rig, target: &DotTarget) -> Self {
        Self { subject: Subject::Target(Arc::new((rig.clone(), target.clone()))), names: names("target", rig.slices()) }
    }
}

fn names(kind: &str, count: usize) -> Vec<String> {
    (0..count).map(|i| format!("{kind}_{i:03}")).collect()
}

impl Slices for Rendered {
    fn count(&self) -> usize {
        self.names.len()
    }

    fn name(&self, index: usize) -> &str {
        self.names.get(index).map_or("(no such slice)", String::as_str)
    }

    fn load(&self, index: usize) -> Result<Raster, Error> {
        if index >= self.names.len() {
            let detail = format!("slice {index} does not exist; the stack has {}", self.names.len());
            return Err(Error::new(ErrorKind::InvalidParameter, detail));
        }
        Ok(match &self.subject {
            Subject::Scene(stage, light) => stage.render(*light, index),
            Subject::Target(plate) => render_target(&plate.0, &plate.1, index),
        })
    }
}
