//! Notes about stacks, scans and profiles.

use super::{scans::with_scan, *};
use crate::store::{
    Attempt, DeleteProfile, Retention,
    notes::{AddNote, NewNote, Subject},
    scans::DeleteScan,
};

fn note(text: &str, author: Option<&str>) -> NewNote {
    NewNote { id: Uuid::now_v7(), text: text.into(), author: author.map(name) }
}

/// The texts of the notes about a subject.
async fn texts(metadata: &dyn MetadataStore, subject: &Subject) -> Vec<String> {
    metadata.notes(subject).await.unwrap().into_iter().map(|note| note.text).collect()
}

/// A stack, a scan and a profile.
async fn subjects(metadata: &dyn MetadataStore) -> [Subject; 3] {
    let stack = accept(metadata, &stack()).await.id;
    with_scan(metadata, "bee").await;
    put(metadata, "rig", "lens", 1.0).await;
    [Subject::Stack(stack), Subject::Scan(name("bee")), Subject::Profile(name("rig"), name("lens"))]
}

pub async fn notes_are_kept_in_their_order_once_and_up_to_a_limit(store: Fresh) {
    let metadata = &*store.metadata;
    for subject in subjects(metadata).await {
        let first = note("K\u{e4}fer\nleft wing", Some("ann"));
        let AddNote::Added(added) = metadata.add_note(&subject, &first, 2).await.unwrap() else { panic!("it is new") };
        assert_eq!((added.id, &added.text, &added.author), (first.id, &first.text, &first.author));
        let again = NewNote { text: "other".into(), ..first.clone() };
        assert_eq!(metadata.add_note(&subject, &again, 2).await.unwrap(), AddNote::Repeated(added.clone()));
        store.clock.advance(Duration::from_secs(60));
        let second = note("b", None);
        assert!(matches!(metadata.add_note(&subject, &second, 2).await.unwrap(), AddNote::Added(_)));
        assert_eq!(metadata.add_note(&subject, &note("c", None), 2).await.unwrap(), AddNote::Full);
        assert_eq!(metadata.add_note(&subject, &again, 2).await.unwrap(), AddNote::Repeated(added.clone()));
        let listed = metadata.notes(&subject).await.unwrap();
        assert_eq!(listed[0], added);
        assert_eq!((listed[1].text.as_str(), &listed[1].author), ("b", &None));
        assert!(listed[1].created_at > added.created_at);
        let other = Subject::Scan(name("wasp"));
        assert!(!metadata.delete_note(&other, first.id).await.unwrap(), "it is about something else");
        assert!(metadata.delete_note(&subject, first.id).await.unwrap());
        assert!(!metadata.delete_note(&subject, first.id).await.unwrap());
        assert_eq!(texts(metadata, &subject).await, ["b"]);
    }
}

pub async fn notes_are_deleted_with_what_they_are_about(store: Fresh) {
    let metadata = &*store.metadata;
    let subjects = subjects(metadata).await;
    for subject in &subjects {
        assert!(matches!(metadata.add_note(subject, &note("a", None), 9).await.unwrap(), AddNote::Added(_)));
    }
    let [Subject::Stack(id), ..] = subjects else { panic!("the first is the stack") };
    let running = claim(metadata).await.expect("it waits");
    assert!(metadata.delete_job(id).await.unwrap());
    assert_eq!(metadata.add_note(&subjects[0], &note("b", None), 9).await.unwrap(), AddNote::NoSubject);
    assert_eq!(texts(metadata, &subjects[1]).await, ["a"], "the others stay");
    assert!(metadata.release(id, running.lease_token, Attempt::NotCounted).await.unwrap());
    assert!(matches!(metadata.delete_scan(&name("bee"), Precondition::Any).await.unwrap(), DeleteScan::Deleted));
    let deleted = metadata.delete_profile(&name("rig"), &name("lens"), Precondition::Any).await.unwrap();
    assert_eq!(deleted, DeleteProfile::Deleted);
    for subject in &subjects {
        assert_eq!(texts(metadata, subject).await, Vec::<String>::new(), "{subject:?}");
        assert_eq!(metadata.add_note(subject, &note("b", None), 9).await.unwrap(), AddNote::NoSubject);
    }
    // those of the same names do not get them
    with_scan(metadata, "bee").await;
    put(metadata, "rig", "lens", 2.0).await;
    assert!(texts(metadata, &subjects[1]).await.is_empty() && texts(metadata, &subjects[2]).await.is_empty());

    let ended = accept(metadata, &stack()).await.id;
    let subject = Subject::Stack(ended);
    assert!(matches!(metadata.add_note(&subject, &note("a", None), 9).await.unwrap(), AddNote::Added(_)));
    let lease = claim(metadata).await.expect("it waits").lease_token;
    assert!(metadata.finish(ended, lease, &success()).await.unwrap());
    store.clock.advance(LEASE);
    let keep = Retention { stacks: Some(Duration::ZERO), ..Retention::default() };
    assert_eq!(metadata.delete_expired_jobs(&keep).await.unwrap(), [ended]);
    assert_eq!(texts(metadata, &subject).await, Vec::<String>::new());
    assert_eq!(metadata.integrity_errors().await.unwrap(), Vec::<String>::new());
}
