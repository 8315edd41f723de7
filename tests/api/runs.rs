//! The page that shows runs of the same pictures side by side.

use pinstack_science::types::metrics::{FocusMetrics, FusionMetrics, MaskMetrics};
use serde_json::{Value, json};

use crate::app::{TestApp, id, problem};

/// Fuses the pictures of a stack again. Returns the id of the run.
async fn again(app: &TestApp, stack: &Value, options: Value) -> String {
    let answer = app.post(&format!("/v1/stacks/{}/rerun", id(stack))).json(&options).send().await.unwrap();
    id(&answer.json::<Value>().await.unwrap()).to_string()
}

/// Finishes the next run with these metrics, with a mask if `object` is its share.
async fn finish(app: &TestApp, q_g_top: f64, label_noise: f64, object: Option<f64>) {
    let job = app.claim().await;
    let mask = object.map(|foreground_fraction| MaskMetrics { foreground_fraction, ..Default::default() });
    app.finish_stack(&job, |outcome| {
        outcome.metrics.fusion = FusionMetrics { q_g_top: Some(q_g_top), ..Default::default() };
        outcome.metrics.focus = FocusMetrics { label_noise: Some(label_noise), ..Default::default() };
        outcome.metrics.mask = mask;
    })
    .await;
}

async fn page(app: &TestApp, path: &str) -> String {
    let answer = app.get(path).send().await.unwrap();
    assert_eq!(answer.status(), 200);
    answer.text().await.unwrap()
}

/// The cells of a row of the table, without their markup.
fn row(page: &str, head: &str) -> Vec<String> {
    let start = page.find(&format!("scope=\"row\">{head}<")).unwrap_or_else(|| panic!("no row {head}: {page}"));
    let row = page[start..].split("</tr>").next().unwrap_or_default();
    let plain = |cell: &str| {
        cell.split('<').map(|part| part.split_once('>').map_or(part, |(_, text)| text)).collect::<String>()
    };
    row.split("<td>").skip(1).map(plain).collect()
}

#[tokio::test]
async fn runs_of_the_same_pictures_stand_side_by_side_with_what_differs() {
    let app = TestApp::start().await;
    let stack = app.with_stack("&method=guided").await;
    let first = id(&stack).to_string();
    finish(&app, 0.70, 0.2, Some(0.4)).await;
    let alone = page(&app, &format!("/stacks/{first}/runs")).await;
    assert!(alone.contains("fused once") && !alone.contains("<table"), "{alone}");
    assert!(!page(&app, &format!("/stacks/{first}")).await.contains("/runs"), "there is nothing to compare");

    let second = again(&app, &stack, json!({ "method": "pyramid", "format": "tiff" })).await;
    finish(&app, 0.80, 0.1, Some(0.4)).await;
    let text = page(&app, &format!("/stacks/{second}/runs")).await;
    assert_eq!(row(&text, "Method"), ["guided filter (paper)", "pyramid"]);
    assert_eq!(row(&text, "Format"), ["PNG", "TIFF"]);
    assert!(!text.contains(">Mask<") && !text.contains(">Profile revision<"), "{text}");
    assert_eq!(row(&text, "Gradients kept (q_g_top)"), ["0.700", "✓ 0.800 (best)"]);
    assert_eq!(row(&text, "Noise of the decision map"), ["0.200", "0.100"], "methods measure focus differently");
    assert_eq!(row(&text, "Object, %"), ["40.00", "40.00"], "neither is better");
    assert!(text.contains(&format!("href=\"/stacks/{first}?compare={second}\"")), "{text}");
    assert!(page(&app, &format!("/stacks/{first}")).await.contains("Compare the 2 runs of these pictures"));

    // the address has the choice; a run without a mask is compared in nothing that a mask changes
    let third = again(&app, &stack, json!({ "mask": "none" })).await;
    finish(&app, 0.90, 0.1, None).await;
    let text = page(&app, &format!("/stacks/{first}/runs")).await;
    assert_eq!(row(&text, "Gradients kept (q_g_top)"), ["0.700", "0.800", "0.900"]);
    let text = page(&app, &format!("/stacks/{third}/runs?{first}=1&{second}=1")).await;
    assert_eq!(row(&text, "Gradients kept (q_g_top)"), ["0.700", "✓ 0.800 (best)"]);
    let text = page(&app, &format!("/stacks/{third}/runs?{first}=1&{third}=1")).await;
    assert_eq!(row(&text, "Mask"), ["if there is a back light", "none"]);

    // the viewer of one run shows the image of the others, and all pictures of the one that it is compared with
    let viewer = page(&app, &format!("/stacks/{first}?compare={second}")).await;
    assert!(viewer.contains(&format!("/stacks/{second}/tiles/depth")), "{viewer}");
    assert!(viewer.contains(&format!("/stacks/{third}/tiles/image")), "{viewer}");
    assert!(!viewer.contains(&format!("/stacks/{third}/tiles/depth")), "{viewer}");

    problem(app.get(&format!("/stacks/{}/runs", "0".repeat(32))).send().await.unwrap(), 404, "not_found").await;
}
