//! The bucket: reachable, with a key that it accepts.

use std::time::Duration;

use tokio::time::timeout;

use super::finding::Finding;
use crate::{settings::Settings, store::s3};

/// How long a bucket may take to answer.
const ANSWER: Duration = Duration::from_secs(30);

/// What the bucket says; `None` without one.
pub(super) async fn finding(config: &Settings) -> Option<Finding> {
    let location = config.storage()?;
    let place = match &location.endpoint {
        Some(endpoint) => format!("{} at {endpoint}", location.url),
        None => location.url.to_string(),
    };
    let how =
        "check the name of the bucket, the address and the key, and that the key may list, read, write and delete";
    Some(match timeout(ANSWER, s3::inspect(&location)).await {
        Ok(Ok(())) => Finding::ok("storage", format!("{place}: it answers and accepts the key")),
        Ok(Err(error)) => Finding::problem("storage", format!("{place}: {error:#}; {how}")),
        Err(_) => {
            let detail = format!("{place}: it does not answer within {} s; check the address", ANSWER.as_secs());
            Finding::problem("storage", detail)
        }
    })
}
