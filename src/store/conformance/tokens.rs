//! Tokens.

use uuid::Uuid;

use super::{Fresh, accept, name, stack};
use crate::store::{
    JobFilter, NewJob, PageRequest,
    tokens::{Scope, mint},
};

pub(crate) async fn a_token_comes_back_as_it_was_added_until_it_is_revoked(store: Fresh) {
    let rows = &*store.rows;
    let (id, secret, _) = mint().unwrap();
    let scopes = [Scope::Read, Scope::ProfilesWrite];
    assert!(rows.add_token(id, &name("ann"), secret.digest(), &scopes).await.unwrap());
    let token = rows.token(id).await.unwrap().expect("it was added");
    assert_eq!((token.name.as_str(), token.scopes.as_slice(), token.revoked_at), ("ann", &scopes[..], None));
    assert!(token.is_opened_by(&secret));
    assert!(!rows.add_token(Uuid::now_v7(), &name("ann"), [0; 32], &scopes).await.unwrap(), "the name is taken");
    assert!(rows.add_token(Uuid::now_v7(), &name("ben"), [1; 32], &[Scope::Admin]).await.unwrap());
    assert!(rows.revoke_token(&name("ann")).await.unwrap());
    assert!(!rows.revoke_token(&name("ann")).await.unwrap() && !rows.revoke_token(&name("nobody")).await.unwrap());
    assert!(!rows.token(id).await.unwrap().expect("it is remembered").is_opened_by(&secret));
    assert!(!rows.add_token(Uuid::now_v7(), &name("ann"), [0; 32], &scopes).await.unwrap(), "and so is its name");
    let listed: Vec<String> = rows.tokens().await.unwrap().iter().map(|token| token.name.to_string()).collect();
    assert_eq!(listed, ["ann", "ben"]);
    assert_eq!(rows.token(Uuid::now_v7()).await.unwrap(), None);
}

pub(crate) async fn a_list_can_be_kept_to_what_one_token_sent(store: Fresh) {
    let rows = &*store.rows;
    let (ann, ben) = (Uuid::now_v7(), Uuid::now_v7());
    let sent = async |owner| accept(rows, &NewJob { owner, ..stack() }).await.id;
    let (of_ann, of_ben, of_nobody) = (sent(Some(ann)).await, sent(Some(ben)).await, sent(None).await);
    assert_eq!(rows.owner(of_ann).await.unwrap(), Some(ann));
    assert_eq!(rows.owner(of_nobody).await.unwrap(), None);
    assert_eq!(rows.owner(Uuid::now_v7()).await.unwrap(), None);
    let page = PageRequest { limit: 10, cursor: None };
    let listed = async |owner| {
        let found = rows.jobs(&JobFilter { owner, ..JobFilter::default() }, &page).await.unwrap();
        found.items.iter().map(|job| job.id).collect::<Vec<_>>()
    };
    assert_eq!(listed(Some(ann)).await, [of_nobody, of_ann]);
    assert_eq!(listed(Some(ben)).await, [of_nobody, of_ben]);
    assert_eq!(listed(None).await, [of_nobody, of_ben, of_ann]);
}
