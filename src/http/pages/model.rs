//! The model of a reconstruction: points, cameras, turntable and surface, drawn by `model.js`. The place is hidden
//! until the script has found that the browser can draw it; the page that has it gives the same as text.

use maud::{Markup, html};

use super::assets;

/// The viewer of a model, with its script: nothing else is needed on the page.
///
/// | argument | URL of |
/// |---|---|
/// | `points` | PLY, binary and little-endian: `x y z`, and `red green blue` |
/// | `cameras` | JSON: `cameras` with `name`, `stack`, `registered`, `center`, `rotation` (world to camera, by rows), `width`, `height`, `focal_px`, `principal_point`; `turntable` with `center`, `axis`, `radius`, or null |
/// | `hull` | GLB, or PLY with faces |
/// | `mesh` | the same; it is within the hull, which is then hidden at first |
pub fn model_viewer(points: Option<&str>, cameras: Option<&str>, hull: Option<&str>, mesh: Option<&str>) -> Markup {
    let parts = [
        ("points", "Points", points.is_some(), true),
        ("hull", "Surface", hull.is_some(), mesh.is_none()),
        ("mesh", "Mesh", mesh.is_some(), true),
        ("cameras", "Cameras", cameras.is_some(), true),
        ("turntable", "Turntable", cameras.is_some(), true),
    ];
    html! {
        section.model aria-label="Model" hidden {
            div.tools {
                @for (name, words, is_there, is_shown) in parts {
                    @if is_there { label.check { input type="checkbox" name=(name) checked[is_shown]; (words) } }
                }
                div.buttons {
                    button type="button" data-look="object" { "Object" }
                    @if cameras.is_some() { button type="button" data-look="all" { "All cameras" } }
                }
            }
            div.scene {
                canvas tabindex="0" role="img" data-points=[points] data-cameras=[cameras] data-hull=[hull] data-mesh=[mesh] aria-describedby="model-keys"
                    aria-label="Model of the reconstruction. The tables of this page have the same as text." {}
            }
            p.readout role="status" { a hidden {} " " span { "Loading the model …" } }
            p.soft.small id="model-keys" {
                "Drag or use the arrow keys to turn it; with Shift they move it. + and − zoom, as do two fingers, and the "
                "wheel after a click. 0 shows it as at first. N and P step through the cameras, Enter opens the stack of one."
            }
        }
        script type="module" src=(assets::url("model.js")) {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_there_is_can_be_shown() {
        let text = model_viewer(Some("/v1/p?a=1&b=2"), None, None, None).into_string();
        assert!(text.contains("data-points=\"/v1/p?a=1&amp;b=2\"") && text.contains("name=\"points\""), "{text}");
        for absent in ["data-cameras", "data-hull", "data-mesh", "name=\"cameras\"", "name=\"hull\"", "All cameras"] {
            assert!(!text.contains(absent), "{absent} in {text}");
        }
        let all = model_viewer(Some("/p"), Some("/c"), Some("/h"), Some("/m")).into_string();
        assert!(
            all.contains("data-cameras=\"/c\" data-hull=\"/h\" data-mesh=\"/m\"") && all.contains("name=\"turntable\""),
            "{all}"
        );
    }
}
