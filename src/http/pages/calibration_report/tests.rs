//! Content, structure, safety and size of the page.

use super::{STYLE, Subject, SubjectProfile, page, testkit};
use pinstack_science::types::{
    Warning, WarningCode,
    report::{CameraReport, Grade},
};

const SUBJECT: Subject<'static> = Subject {
    profile: SubjectProfile::Stored { rig: "bench", lens: "macro-65", revision: Some(4) },
    measured: "2026-05-04 10:12 UTC",
    note: Some("after cleaning"),
};

fn count(text: &str, what: &str) -> usize {
    text.matches(what).count()
}

/// Checks that tags are closed in order and that attribute values are quoted.
fn check_tags(html: &str) {
    let mut open: Vec<&str> = Vec::new();
    let void = ["meta", "!DOCTYPE"];
    let body = html.replace(STYLE, "");
    let mut rest = body.as_str();
    while let Some(from) = rest.find('<') {
        let after = rest.get(from + 1..).expect("more");
        let to = after.find('>').expect("a tag ends");
        let tag = after.get(..to).expect("a tag");
        assert_eq!(count(tag, "\"") % 2, 0, "quotes of <{tag}>");
        assert!(!tag.contains('<'), "<{tag}>");
        let name = tag.split([' ', '/']).find(|part| !part.is_empty()).expect("a name");
        if let Some(closed) = tag.strip_prefix('/') {
            assert_eq!(open.pop(), Some(closed));
        } else if !tag.ends_with('/') && !void.contains(&name) {
            open.push(name);
        }
        rest = after.get(to + 1..).expect("more");
    }
    assert!(open.is_empty(), "{open:?}");
}

#[test]
fn the_sections_are_in_order_from_the_verdict_to_the_table_of_all_values() {
    let report = testkit::report(13);
    let html = page(&SUBJECT, &report, Some(&testkit::drift(13, 1.8)));
    check_tags(&html);
    let places: Vec<usize> = [
        "The image corners are good to 0.21 px",
        "<h2>Findings",
        "<h2>What was measured",
        "<h2>Residuals of the dots",
        "<h2>Charts over the slices",
        "<h2>Why this model",
        "<h2>Drift since the previous revision",
        "<h2>All values",
    ]
    .iter()
    .map(|what| html.find(what).unwrap_or_else(|| panic!("no {what}")))
    .collect();
    assert!(places.is_sorted(), "{places:?}");
    assert!(html.contains("</span> Good</span>"), "the grade is a word, not only a colour");
    assert!(html.contains("Slice 7 moved most: 1.8 px at a corner since revision 3"));
    assert_eq!(count(&html, "aria-label=\"Residuals of slice"), 13);
    assert_eq!(count(&html, "<title>outlier, 2.25 px off</title>"), 2, "both outliers of the third slice");
    assert!(html.contains("2 outliers") && html.contains("enlarged 500 times"), "the enlargement is stated");
    assert!(html.contains(">limit</text>") && html.contains(">0.3 px</text>"), "limits are drawn");
    assert!(html.contains("href=\"overlay?slice=12\"") && html.contains("✓ chosen"));
    assert!(html.contains("59.520 ± 0.083 mm = 13227.0 px") && html.contains("pupil ratio 1.2;"));
}

#[test]
fn the_page_loads_nothing_and_runs_nothing() {
    let html = page(&SUBJECT, &testkit::report(13), None);
    for forbidden in
        ["<script", "<link", "<img", "<iframe", "@import", "url(", "src=", "style=", "onload", "http://", "https://"]
    {
        assert!(!html.contains(forbidden), "{forbidden}");
    }
    assert_eq!(count(&html, "<style>"), 1);
    assert!(html.contains(&format!("<style>{STYLE}</style>")), "the policy names the hash of exactly these bytes");
    assert!(html.contains("no two revisions"));
}

#[test]
fn names_and_sentences_are_escaped() {
    let evil = "<script>alert('x')</script>\"><svg onload=alert(1)>&\u{202e}gnp.exe\u{0}.png";
    let mut report = testkit::report(13);
    report.slices[3].name = evil.into();
    report.verdict = evil.into();
    report.findings = vec![Warning::new(WarningCode::Other("<b>".into()), evil)];
    report.model_reason = evil.into();
    report.capture.detail = evil.into();
    report.camera.detail = evil.into();
    let mut drift = testkit::drift(13, 0.1);
    drift.detail = evil.into();
    let subject = Subject {
        profile: SubjectProfile::Stored { rig: evil, lens: evil, revision: Some(1) },
        measured: evil,
        note: Some(evil),
    };
    let html = page(&subject, &report, Some(&drift));
    check_tags(&html);
    assert!(!html.contains("<script") && !html.contains("<svg onload") && !html.contains("<b>"));
    assert!(!html.contains('\u{202e}') && !html.contains('\0'));
    assert!(html.contains("&lt;script&gt;alert(&#39;x&#39;)&lt;/script&gt;&quot;&gt;"));
}

#[test]
fn an_interpolated_slice_is_marked_in_every_drawing() {
    let html = page(&SUBJECT, &testkit::report(13), None);
    let map = html.split("aria-label=\"Residuals of slice 12").nth(1).expect("its map");
    let map = map.split("</figure>").next().expect("its end");
    assert!(map.contains("stroke-dasharray") && map.contains("interpolated") && !map.contains("class=\"a\""), "{map}");
    // scale, shift (two marks), gain, corner uncertainty, and the title of the map; blur and the distance from the rail
    // law were not measured
    assert_eq!(count(&html, " interpolated</title>"), 5 + 1);
    assert_eq!(count(&html, "class=\"p h\""), 4 + 1, "hollow marks, and the one of the key");
    assert!(html.contains("<tr class=\"guess\">"));
}

#[test]
fn a_report_with_missing_values_is_still_a_valid_page() {
    let mut report = testkit::report(3);
    report.grade = Grade::Poor;
    report.findings.clear();
    report.candidates.clear();
    report.rail = None;
    report.camera = CameraReport::default();
    for slice in &mut report.slices {
        slice.dots.clear();
        (slice.law_scale, slice.law_shift_px, slice.off_law_px, slice.blur_radius_px) = (None, None, None, None);
        slice.scale = f64::NAN;
        slice.corner_sigma_px = f64::INFINITY;
    }
    let html = page(&SUBJECT, &report, None);
    check_tags(&html);
    for said in
        ["No rail law was fitted.", "Not measured.", "Not known", "No other models", "No problems were found", "✕"]
    {
        assert!(html.contains(said), "{said}");
    }
    assert!(!html.contains("NaN") && !html.contains("inf "), "values that are not finite are dashes");
    report.slices.clear();
    check_tags(&page(&SUBJECT, &report, None));
}

#[test]
fn a_report_without_a_target_says_what_it_is_and_nothing_of_dots() {
    let mut report = testkit::report(5);
    report.target = None;
    report.verdict = "Usable: calibrated from 2 stacks of the object itself".into();
    report.model_reason = "it is the simplest".into();
    report.findings.clear();
    for candidate in &mut report.candidates {
        (candidate.held_out_px, candidate.bic) = (None, None);
    }
    for slice in &mut report.slices {
        (slice.dots, slice.dots_found, slice.inliers, slice.interpolated) = (Vec::new(), 0, 0, false);
        (slice.law_scale, slice.law_shift_px, slice.off_law_px, slice.blur_radius_px) = (None, None, None, None);
        (slice.contrast, slice.clipped, slice.corner_sigma_px) = (None, None, 0.25);
        slice.rms_px = Some(0.5);
    }
    let html = page(&SUBJECT, &report, None);
    check_tags(&html);
    assert!(html.contains("<dt>Made from</dt>") && html.contains("worst image corner is 0.25 px: expect"));
    for gone in ["dots", "Target", "Residuals", "interpolated", "rail law", "limit", "held-out", "BIC", "Blur", ">–<"]
    {
        assert!(!html.replace(STYLE, "").contains(gone), "{gone}");
    }
    assert_eq!(count(&html, "<figure>"), 4, "scale, shift, gain and uncertainty");
}

#[test]
fn sixty_slices_fit_in_two_megabytes_and_a_thousand_do_not_make_it_ten() {
    let html = page(&SUBJECT, &testkit::report(60), Some(&testkit::drift(60, 0.5)));
    assert!(html.len() < 2_000_000, "{} bytes", html.len());
    let mut many = testkit::report(13);
    let slice = many.slices[1].clone();
    many.slices = (0..1000).map(|_| slice.clone()).collect();
    let html = page(&SUBJECT, &many, Some(&testkit::drift(1000, 0.5)));
    check_tags(&html);
    assert!(html.len() < 4_000_000, "{} bytes", html.len());
    assert!(html.contains("of 1000 slices are drawn"));
}
