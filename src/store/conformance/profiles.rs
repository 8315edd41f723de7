//! Profiles and revisions.

use super::*;
use crate::{
    contract::{ProfileSummary, profile::ProfileOrigin},
    store::{
        DeleteProfile,
        digest::{optics_digest, profile_digest},
    },
};
use pinstack_science::types::{Warning, WarningCode};

pub async fn a_profile_comes_back_as_it_was_put(store: Fresh) {
    let put = put(&*store.metadata, "rig", "lens", 1.25).await;
    assert_eq!(put.revision, 1);
    assert_eq!(put.slice_count, 2);
    assert_eq!((&put.digest, &put.optics_digest), (&profile_digest(&put.input), &optics_digest(&put.input)));
    let got = store.metadata.profile(&name("rig"), &name("lens"), None).await.unwrap();
    assert_eq!(got, Some(put));
}

pub async fn an_imported_profile_remembers_its_origin_and_its_warnings(store: Fresh) {
    let origin = ProfileOrigin {
        rig: name("there"),
        lens: name("macro"),
        revision: 7,
        digest: "0".repeat(64),
        created_at: jiff::Timestamp::UNIX_EPOCH,
        calibration_id: Some(uuid::Uuid::nil()),
    };
    let warnings = vec![Warning::new(WarningCode::Rebased, "based on slice 1")];
    let mut draft = ProfileDraft { origin: Some(origin.clone()), warnings: warnings.clone(), ..draft(1.5) };
    (draft.input.principal_distance_mm, draft.input.pixel_pitch_mm) = (Some(130.0), Some(0.5));
    let (rig, lens) = (name("rig"), name("lens"));
    store.metadata.put_profile(&rig, &lens, &draft, Precondition::Any).await.unwrap();
    let got = store.metadata.profile(&rig, &lens, None).await.unwrap().expect("it was stored");
    assert_eq!((got.origin, got.warnings, got.principal_distance_px), (Some(origin), warnings, Some(260.0)));
}

pub async fn every_write_is_a_new_revision_and_old_ones_never_change(store: Fresh) {
    let metadata = &*store.metadata;
    let first = put(metadata, "rig", "lens", 1.25).await;
    store.clock.advance(Duration::from_secs(60));
    let second = put(metadata, "rig", "lens", 1.5).await;
    assert_eq!((first.revision, second.revision), (1, 2));
    assert!(second.created_at > first.created_at);
    let (rig, lens) = (name("rig"), name("lens"));
    assert_eq!(metadata.profile(&rig, &lens, Some(1)).await.unwrap(), Some(first.clone()));
    assert_eq!(metadata.profile(&rig, &lens, None).await.unwrap(), Some(second.clone()));
    assert_eq!(metadata.profile(&rig, &lens, Some(3)).await.unwrap(), None);
    let all = metadata.revisions(&rig, &lens, &page(10, None)).await.unwrap();
    let summaries = [&second, &first].map(ProfileSummary::from);
    assert_eq!((all.items, all.next_cursor), (summaries.to_vec(), None));
    let stored = metadata.all_revisions(&page(10, None)).await.unwrap();
    assert_eq!((stored.items, stored.skipped), (vec![second, first], vec![]));
}

pub async fn preconditions_decide_a_race(store: Fresh) {
    let metadata = &*store.metadata;
    let (rig, lens) = (name("rig"), name("lens"));
    let try_put = async |condition| metadata.put_profile(&rig, &lens, &draft(1.5), condition).await.unwrap();
    assert_eq!(try_put(Precondition::Present).await, PutProfile::PreconditionFailed(None));
    assert_eq!(try_put(Precondition::Revision(1)).await, PutProfile::PreconditionFailed(None));
    assert!(matches!(try_put(Precondition::Absent).await, PutProfile::Created(p) if p.revision == 1));
    assert_eq!(try_put(Precondition::Absent).await, PutProfile::PreconditionFailed(Some(1)));
    assert!(matches!(try_put(Precondition::Revision(1)).await, PutProfile::Updated(p) if p.revision == 2));
    assert_eq!(try_put(Precondition::Revision(1)).await, PutProfile::PreconditionFailed(Some(2)));
    let refused = metadata.delete_profile(&rig, &lens, Precondition::Revision(1)).await.unwrap();
    assert_eq!(refused, DeleteProfile::PreconditionFailed(Some(2)));
    assert!(metadata.profile(&rig, &lens, None).await.unwrap().is_some());
}

pub async fn a_delete_hides_the_profile_and_keeps_the_numbering(store: Fresh) {
    let metadata = &*store.metadata;
    let (rig, lens) = (name("rig"), name("lens"));
    put(metadata, "rig", "lens", 1.25).await;
    let second = put(metadata, "rig", "lens", 1.5).await;
    for expected in [DeleteProfile::Deleted, DeleteProfile::NotFound] {
        assert_eq!(metadata.delete_profile(&rig, &lens, Precondition::Any).await.unwrap(), expected);
    }
    assert_eq!(metadata.profile(&rig, &lens, None).await.unwrap(), None);
    assert_eq!(metadata.profile(&rig, &lens, Some(2)).await.unwrap(), None);
    assert!(metadata.revisions(&rig, &lens, &page(10, None)).await.unwrap().items.is_empty());
    assert!(metadata.profiles(None, None, &page(10, None)).await.unwrap().items.is_empty());
    // existing stacks still refer to it
    assert_eq!(metadata.profile_of_job(&rig, &lens, 2).await.unwrap(), Some(second));
    assert_eq!(metadata.all_revisions(&page(10, None)).await.unwrap().items.len(), 2);
    assert!(metadata.profile_keys(10).await.unwrap().is_empty());
    let third = metadata.put_profile(&rig, &lens, &draft(1.5), Precondition::Absent).await.unwrap();
    assert!(matches!(third, PutProfile::Created(p) if p.revision == 3));
    let visible = metadata.revisions(&rig, &lens, &page(10, None)).await.unwrap();
    assert_eq!(visible.items.iter().map(|p| p.revision).collect::<Vec<_>>(), [3]);
}

pub async fn lists_are_paged_newest_first_and_filtered(store: Fresh) {
    let metadata = &*store.metadata;
    for lens in ["a", "b", "c", "d", "e"] {
        put(metadata, "one", lens, 1.25).await;
    }
    put(metadata, "two", "a", 1.25).await;
    put(metadata, "one", "b", 1.5).await;
    let key = |p: &ProfileSummary| format!("{}/{}@{}", p.rig, p.lens, p.revision);
    let mut seen = Vec::new();
    let mut cursor = None;
    loop {
        let found = metadata.profiles(None, None, &page(2, cursor)).await.unwrap();
        assert!((1..=2).contains(&found.items.len()));
        seen.extend(found.items.iter().map(key));
        cursor = found.next_cursor;
        if cursor.is_none() {
            break;
        }
    }
    assert_eq!(seen, ["one/b@2", "two/a@1", "one/e@1", "one/d@1", "one/c@1", "one/a@1"]);
    let of_two = metadata.profiles(Some(&name("two")), None, &page(10, None)).await.unwrap();
    assert_eq!(of_two.items.iter().map(key).collect::<Vec<_>>(), ["two/a@1"]);
    let a = metadata.profiles(None, Some(&name("a")), &page(10, None)).await.unwrap();
    assert_eq!(a.items.iter().map(key).collect::<Vec<_>>(), ["two/a@1", "one/a@1"]);
}

pub async fn the_keys_of_profiles_are_listed(store: Fresh) {
    let metadata = &*store.metadata;
    for lens in ["b", "a", "b"] {
        put(metadata, "rig", lens, 1.25).await;
    }
    let keys = [(name("rig"), name("a")), (name("rig"), name("b"))];
    assert_eq!(metadata.profile_keys(10).await.unwrap(), keys);
    assert_eq!(metadata.profile_keys(1).await.unwrap(), keys[..1]);
}

pub async fn a_profile_that_could_not_be_read_again_is_not_stored(store: Fresh) {
    let metadata = &*store.metadata;
    let first = put(metadata, "rig", "lens", 1.25).await;
    let mut draft = draft(1.5);
    draft.slices[1].shift_px[0] = f64::INFINITY;
    let refused = metadata.put_profile(&first.rig, &first.lens, &draft, Precondition::Any).await;
    assert!(refused.is_err_and(|error| crate::store::json::is_not_storable(&error)));
    assert_eq!(metadata.profile(&first.rig, &first.lens, None).await.unwrap().as_ref(), Some(&first));
    assert_eq!(put(metadata, "rig", "lens", 1.5).await.revision, 2, "and its number was not used");
}

pub async fn a_foreign_cursor_is_refused(store: Fresh) {
    for cursor in ["", "nonsense", "-1", "0", "fffffffffffffffff"] {
        let asked = page(10, Some(cursor.into()));
        let profiles = store.metadata.profiles(None, None, &asked).await;
        assert!(matches!(profiles, Err(crate::store::StoreError::InvalidCursor)), "{cursor}");
        let jobs = store.metadata.jobs(&Default::default(), &asked).await;
        assert!(matches!(jobs, Err(crate::store::StoreError::InvalidCursor)), "{cursor}");
    }
}

pub async fn concurrent_writes_each_get_a_revision_of_their_own(store: Fresh) {
    let writes = (0..12).map(|i| {
        let metadata = Arc::clone(&store.metadata);
        async move { put(&*metadata, "rig", "lens", 1.0 + f64::from(i) / 64.0).await.revision }
    });
    let mut revisions = futures::future::join_all(writes).await;
    revisions.sort_unstable();
    assert_eq!(revisions, (1..=12).collect::<Vec<u32>>());
}
