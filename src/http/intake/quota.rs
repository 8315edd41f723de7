//! The quota of a token while its uploads arrive.
//!
//! The quota itself holds in the store, in the transaction that accepts a job or an upload. Here it is looked at before
//! and while the bytes come, so that no upload is sent for nothing: what the store counts and what other requests of
//! the token have claimed must leave room.

use std::{
    collections::HashMap,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

use uuid::Uuid;

use crate::{
    contract::Code,
    http::{
        auth::Caller,
        problem::{ApiError, ApiResult},
        state::App,
    },
    store::OverQuota,
};

/// An upload of unknown length claims so much ahead of what has arrived.
const AHEAD_OF_UNKNOWN: u64 = 64 << 20;

/// Bytes that the requests of each token have claimed and that are not in the store yet.
#[derive(Clone, Default)]
pub struct Claims(Arc<Mutex<HashMap<Uuid, u64>>>);

impl Claims {
    fn lock(&self) -> MutexGuard<'_, HashMap<Uuid, u64>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What one request claims of the quota of its token; given back when dropped. Without a quota it claims nothing.
#[derive(Default)]
pub struct QuotaClaim(Option<Claimed>);

struct Claimed {
    app: App,
    token: Uuid,
    name: String,
    quota: u64,
    /// The `Idempotency-Key` as the store has it. Repeats of one request at the same time make one job, so they do not
    /// stand in each other's way.
    key: Option<String>,
    bytes: u64,
}

impl QuotaClaim {
    /// An empty claim on the quota of the caller.
    pub fn of(app: &App, caller: &Caller, key: Option<String>) -> Self {
        let limited = caller.token().and_then(|token| Some((token, token.quota_bytes?)));
        Self(limited.map(|(token, quota)| Claimed {
            app: app.clone(),
            token: token.id,
            name: token.name.to_string(),
            quota,
            key,
            bytes: 0,
        }))
    }

    /// Claims enough for `bytes` in all.
    ///
    /// # Errors
    /// `insufficient_storage` with figures.
    pub async fn cover(&mut self, bytes: u64) -> ApiResult<()> {
        let Some(claimed) = &mut self.0 else { return Ok(()) };
        if bytes <= claimed.bytes {
            return Ok(());
        }
        let used = claimed.app.rows.used_bytes(claimed.token).await?;
        // what arrived is more than was claimed at first: the length is unknown
        let ahead = if claimed.bytes > 0 { AHEAD_OF_UNKNOWN } else { 0 };
        let Err(used) = claimed.take(used, bytes.saturating_add(ahead)).or_else(|_| claimed.take(used, bytes)) else {
            return Ok(());
        };
        if let Some(key) = &claimed.key
            && claimed.app.rows.by_idempotency_key(key).await?.is_some()
        {
            // the request is a repeat by now: it takes nothing
            self.0 = None;
            return Ok(());
        }
        Err(over_quota(bytes, &OverQuota { token: claimed.name.clone(), used, quota: claimed.quota }))
    }
}

impl Claimed {
    /// Claims `bytes` in all, or says how many bytes are used.
    fn take(&mut self, stored: u64, bytes: u64) -> Result<(), u64> {
        let mut claims = self.app.claims.lock();
        let all = claims.entry(self.token).or_default();
        let others = if self.key.is_some() { 0 } else { *all - self.bytes };
        let used = stored.saturating_add(others);
        if used.saturating_add(bytes) > self.quota {
            return Err(used);
        }
        *all += bytes - self.bytes;
        self.bytes = bytes;
        Ok(())
    }
}

impl Drop for Claimed {
    fn drop(&mut self) {
        let mut claims = self.app.claims.lock();
        if let Some(all) = claims.get_mut(&self.token) {
            *all -= self.bytes;
            if *all == 0 {
                claims.remove(&self.token);
            }
        }
    }
}

/// An upload of `bytes` does not fit into the quota.
pub fn over_quota(bytes: u64, over: &OverQuota) -> ApiError {
    let OverQuota { token, used, quota } = over;
    let detail = format!(
        "no room for this upload in the quota of token '{token}': it needs {bytes} bytes, and {used} of {quota} are \
         used; delete old stacks, or ask for a larger quota"
    );
    ApiError::new(Code::InsufficientStorage, detail)
}
