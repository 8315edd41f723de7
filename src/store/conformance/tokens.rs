//! Tokens.

use std::time::Duration;

use uuid::Uuid;

use super::{Fresh, accept, claim, name, stack, success, uploads::MANY};
use crate::store::{
    JobFilter, NewJob, PageRequest, Retention,
    tokens::{NewToken, Scope, mint},
    uploads::{CreateUpload, NewUpload},
};

pub async fn a_token_comes_back_as_it_was_added_until_it_is_revoked(store: Fresh) {
    let metadata = &*store.metadata;
    let (id, secret, _) = mint().unwrap();
    let scopes = [Scope::Read, Scope::ProfilesWrite];
    let add = async |id, text, digest, scopes: &[Scope], quota_bytes| {
        let token = NewToken { id, name: name(text), digest, scopes: scopes.to_vec(), quota_bytes };
        metadata.add_token(&token).await.unwrap()
    };
    assert!(add(id, "ann", secret.digest(), &scopes, Some(7)).await);
    let token = metadata.token(id).await.unwrap().expect("it was added");
    assert_eq!((token.name.as_str(), token.scopes.as_slice(), token.revoked_at), ("ann", &scopes[..], None));
    assert!(token.is_opened_by(&secret));
    assert_eq!(token.quota_bytes, Some(7));
    assert!(!add(Uuid::now_v7(), "ann", [0; 32], &scopes, None).await, "the name is taken");
    assert!(add(Uuid::now_v7(), "ben", [1; 32], &[Scope::Admin], None).await);
    assert!(metadata.revoke_token(&name("ann")).await.unwrap());
    assert!(!metadata.revoke_token(&name("ann")).await.unwrap() && !metadata.revoke_token(&name("zoe")).await.unwrap());
    assert!(!metadata.token(id).await.unwrap().expect("it is remembered").is_opened_by(&secret));
    assert!(!add(Uuid::now_v7(), "ann", [0; 32], &scopes, None).await, "and so is its name");
    let listed: Vec<String> = metadata.tokens().await.unwrap().iter().map(|token| token.name.to_string()).collect();
    assert_eq!(listed, ["ann", "ben"]);
    assert_eq!(metadata.token(Uuid::now_v7()).await.unwrap(), None);
}

pub async fn a_list_can_be_restricted_to_the_jobs_of_one_token(store: Fresh) {
    let metadata = &*store.metadata;
    let (ann, ben) = (Uuid::now_v7(), Uuid::now_v7());
    let sent = async |owner| accept(metadata, &NewJob { owner, ..stack() }).await.id;
    let (of_ann, of_ben, without_owner) = (sent(Some(ann)).await, sent(Some(ben)).await, sent(None).await);
    assert_eq!(metadata.owner(of_ann).await.unwrap(), Some(ann));
    assert_eq!(metadata.owner(without_owner).await.unwrap(), None);
    assert_eq!(metadata.owner(Uuid::now_v7()).await.unwrap(), None);
    let page = PageRequest { limit: 10, cursor: None };
    let listed = async |owner| {
        let found = metadata.jobs(&JobFilter { owner, ..JobFilter::default() }, &page).await.unwrap();
        found.items.iter().map(|job| job.id).collect::<Vec<_>>()
    };
    assert_eq!(listed(Some(ann)).await, [without_owner, of_ann]);
    assert_eq!(listed(Some(ben)).await, [without_owner, of_ben]);
    assert_eq!(listed(None).await, [without_owner, of_ben, of_ann]);
}

pub async fn the_bytes_of_a_token_are_counted_until_they_are_removed(store: Fresh) {
    const DAY: Duration = Duration::from_secs(24 * 60 * 60);
    let metadata = &*store.metadata;
    let (ann, ben) = (Uuid::now_v7(), Uuid::now_v7());
    let id = accept(metadata, &NewJob { owner: Some(ann), ..stack() }).await.id;
    // as in the requests and outcomes of these tests
    let (upload, results) = (12, 3);
    assert_eq!((metadata.used_bytes(ann).await.unwrap(), metadata.used_bytes(ben).await.unwrap()), (upload, 0));
    assert!(metadata.finish(claim(metadata).await.unwrap().id, 1, &success()).await.unwrap());
    assert_eq!(metadata.used_bytes(ann).await.unwrap(), upload + results);
    let arriving = NewUpload {
        id: Uuid::now_v7(),
        length: 1000,
        digest: vec![],
        metadata: String::new(),
        keep: DAY,
        owner: Some(ann),
    };
    assert!(matches!(metadata.create_upload(&arriving, MANY).await.unwrap(), CreateUpload::Created(_)));
    assert_eq!(metadata.used_bytes(ann).await.unwrap(), 1000 + upload + results, "what is to come is counted whole");
    store.clock.advance(DAY);
    let keep = Retention { uploads: Some(DAY), ..Retention::default() };
    assert_eq!(metadata.expire_job_uploads(&keep).await.unwrap(), [id]);
    assert_eq!(metadata.used_bytes(ann).await.unwrap(), results);
    metadata.delete_job(id).await.unwrap();
    assert_eq!(metadata.used_bytes(ann).await.unwrap(), 0);
}
