//! Which stacks are one view, and how views are named.

use super::*;

fn stack(label: Option<&str>, pan_deg: Option<f64>, tilt_deg: Option<f64>) -> ViewStack {
    let id = Uuid::now_v7();
    ViewStack {
        id,
        state: JobState::Succeeded,
        progress: Progress::default(),
        error: None,
        created_at: Timestamp::UNIX_EPOCH,
        warnings: Vec::new(),
        label: label.map(Into::into),
        pan_deg,
        tilt_deg,
        filename: Some("stack 7.zip".into()),
        profile_revision: 1,
        profile_digest: String::new(),
        slice_size: [24, 18],
        upload_removed: false,
        pictures: Vec::new(),
        origin: id,
        result: None,
    }
}

fn stems(stacks: Vec<ViewStack>) -> Vec<String> {
    by_view(stacks).into_iter().map(|view| view.stem).collect()
}

#[test]
fn views_are_sorted_by_tilt_and_pan_and_named_by_label_or_angles() {
    let stacks = vec![
        stack(None, Some(20.0), Some(6.0)),
        stack(None, Some(0.0), Some(6.0)),
        stack(Some("head on"), Some(40.0), Some(0.0)),
    ];
    assert_eq!(stems(stacks), ["head_on", "pan000_tilt06", "pan020_tilt06"]);
}

#[test]
fn a_name_has_no_angle_that_is_unknown() {
    let stacks = vec![
        stack(None, Some(20.5), None),
        stack(None, None, Some(-6.0)),
        stack(Some("bee"), Some(20.0), None),
        stack(Some("bee"), None, Some(6.0)),
    ];
    let stems = stems(stacks);
    assert_eq!(stems, ["tilt-06", "bee_tilt06", "bee_pan020", "pan020p5"]);
    assert!(stems.iter().all(|stem| ViewAngles::of_name(stem).is_none()), "no angle is made up");
}

#[test]
fn a_label_that_several_views_share_is_told_apart_by_angles() {
    let stacks = vec![
        stack(Some("bee"), Some(20.0), Some(0.0)),
        stack(Some("Bee"), Some(0.0), Some(0.0)),
        stack(Some("a b"), None, None),
        stack(Some("a.b"), None, None),
    ];
    assert_eq!(stems(stacks), ["Bee_pan000_tilt00", "bee_pan020_tilt00", "a_b_1", "a_b_2"]);
}

#[test]
fn a_number_that_another_label_ends_with_is_not_given_again() {
    let stacks = ["bee 1", "bee_1", "bee_1_1"].map(|label| stack(Some(label), None, None));
    let stems = stems(stacks.into());
    assert_eq!(stems.iter().collect::<std::collections::HashSet<_>>().len(), 3, "{stems:?}");
    assert!(stems.contains(&"bee_1_1".to_owned()), "{stems:?}");
}

#[test]
fn a_label_in_another_normal_form_is_the_same_view() {
    let stacks = ["Ka\u{308}fer", "Käfer"].map(|label| stack(Some(label), None, None));
    assert_eq!(stems(stacks.into()), ["K_fer"]);
    assert_eq!(stems(vec![stack(Some("Käfer"), None, None), stack(Some("käfer"), None, None)]).len(), 2);
}

#[test]
fn the_newest_stack_that_did_not_fail_counts() {
    let failed = ViewStack { state: JobState::Failed, ..stack(None, Some(20.0), Some(0.0)) };
    let (newer, older) = (stack(None, Some(20.0), Some(0.0)), stack(None, Some(20.0004), Some(0.0)));
    let views = by_view(vec![failed.clone(), newer.clone(), older.clone()]);
    assert_eq!(views.len(), 1);
    assert_eq!((views[0].stack.id, &views[0].others), (newer.id, &vec![failed.id, older.id]));
    let all_failed = by_view(vec![failed.clone(), ViewStack { state: JobState::Cancelled, ..older }]);
    assert_eq!(all_failed[0].stack.id, failed.id);
}

#[test]
fn an_unnamed_view_keeps_its_name_when_it_is_fused_again() {
    let first = stack(None, None, None);
    let again = ViewStack { origin: first.id, ..stack(None, None, None) };
    let third = ViewStack { origin: again.id, ..stack(None, None, None) };
    let other = stack(None, None, None);
    let name = stems(vec![first.clone()]);
    let views = by_view(vec![other, third.clone(), again, first]);
    assert_eq!(views.len(), 2);
    let view = views.iter().find(|view| view.stack.id == third.id).expect("the newest counts");
    assert_eq!(view.others.len(), 2);
    assert!(name[0].starts_with("stack_7_"), "{name:?}");
}

#[test]
fn a_label_that_windows_cannot_write_as_a_file_gets_another_name() {
    let stacks = ["Con", "lpt1", "console"].map(|label| stack(Some(label), None, None));
    assert_eq!(stems(stacks.into()), ["_Con", "_lpt1", "console"]);
}
