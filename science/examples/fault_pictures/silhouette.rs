//! Back lights with faults, and what is cut out with them.

use pinstack_science::{
    imaging::{Raster, Samples},
    segmentation::{MaskParams, segment},
    synth::{Light, Rig, Scene, Stage},
};

use crate::stack::{fused, true_plan};

/// Makes a back-lit slice from what the lamp behind and the lamp before the object give, 0..255, and the place, 0..1.
pub type Exposure = fn(f32, f32, [f32; 2]) -> f32;

/// The code of each picture, the code that its mask is reported with, and the lamps.
pub const OF_MASKS: [(&str, &str, Exposure); 2] = [
    // the front lamp was left on: shiny parts look as if the back light passed through
    ("mask_low_separability", "mask_translucent", |back, front, _| 0.05 * back + 1.8 * front),
    // a small lamp to the left
    ("mask_uneven_light", "mask_uneven_light", |back, _, [x, y]| {
        back * (-3.2 * ((x - 0.15).powi(2) + (y - 0.5).powi(2))).exp() + 3.0
    }),
];

/// The fused back light, what is cut out of the fused front light, and the codes that are reported.
pub fn silhouette(make: Exposure) -> (Raster, Raster, Vec<String>) {
    let rig = Rig::sized(480, 360, 13);
    let stage = Stage::new(&rig, &Scene::insect(1).scaled(0.9));
    let front: Vec<Raster> = (0..rig.slices()).map(|i| stage.render(Light::Front, i)).collect();
    let back: Vec<Raster> =
        front.iter().enumerate().map(|(i, front)| mixed(&stage.render(Light::Back, i), front, make)).collect();
    let plan = true_plan(&rig);
    let light = fused(&back, &plan, None);
    let found = segment(&light.image, &light.valid, &MaskParams::default_for(rig.width, rig.height));
    let mut cut_out = fused(&front, &plan, None).image;
    let Samples::Eight(samples) = &mut cut_out.samples else { panic!("8 bits expected") };
    for (pixel, &mask) in samples.chunks_exact_mut(3).zip(&found.mask.data) {
        if mask == 0 {
            pixel.fill(0);
        }
    }
    (light.image, cut_out, found.warnings.into_iter().map(|warning| warning.code.to_string()).collect())
}

fn mixed(back: &Raster, front: &Raster, make: Exposure) -> Raster {
    let (Samples::Eight(b), Samples::Eight(f)) = (&back.samples, &front.samples) else { panic!("8 bits expected") };
    let sample = |at: usize| {
        let (x, y) = (at / 3 % back.width, at / 3 / back.width);
        let place = [x as f32 / back.width as f32, y as f32 / back.height as f32];
        make(f32::from(b[at]), f32::from(f[at]), place).round().clamp(0.0, 255.0) as u8
    };
    Raster::eight(back.width, back.height, 3, (0..b.len()).map(sample).collect())
}
