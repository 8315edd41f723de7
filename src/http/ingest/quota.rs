//! The quota of a token while its uploads arrive.
//!
//! The store enforces the quota, in the transaction that accepts a job or an upload. This check comes earlier, before
//! and during the upload, so that no client sends gigabytes in vain. It adds what the store counts and what other
//! requests of the token have claimed:
//!
//! ```text
//! stored bytes + claims of other requests + this claim <= quota
//! ```

use std::sync::Arc;

use uuid::Uuid;

use crate::{
    contract::Code,
    http::{ApiError, ApiResult, App, auth::Caller, state::token_sums::TokenSums},
    store::{MetadataStore, OverQuota},
};

/// Bytes that an upload of unknown length claims ahead of what has arrived.
const AHEAD_OF_UNKNOWN: u64 = 64 << 20;

/// The claim of one request on the quota of its token, released on drop. Empty for a token without a quota.
#[derive(Default)]
pub struct QuotaClaim(Option<Claimed>);

struct Claimed {
    metadata: Arc<dyn MetadataStore>,
    claims: TokenSums,
    token: Uuid,
    name: String,
    quota: u64,
    /// The `Idempotency-Key` as the store keeps it. Simultaneous repeats of one request make one job, so a claim with
    /// a key ignores the claims of other requests.
    key: Option<String>,
    bytes: u64,
}

impl QuotaClaim {
    /// An empty claim on the quota of the caller.
    pub fn of(app: &App, caller: &Caller, key: Option<String>) -> Self {
        let limited = caller.token().and_then(|token| Some((token, token.quota_bytes?)));
        Self(limited.map(|(token, quota)| Claimed {
            metadata: Arc::clone(&app.store.metadata),
            claims: app.claims.clone(),
            token: token.id,
            name: token.name.to_string(),
            quota,
            key,
            bytes: 0,
        }))
    }

    /// Raises the claim to `bytes` in all, if it is smaller.
    ///
    /// # Errors
    /// `insufficient_storage` with figures.
    pub async fn cover(&mut self, bytes: u64) -> ApiResult<()> {
        let Some(claimed) = &mut self.0 else { return Ok(()) };
        if bytes <= claimed.bytes {
            return Ok(());
        }
        let used = claimed.metadata.used_bytes(claimed.token).await?;
        // more arrived than was first claimed, so the length is unknown
        let ahead = if claimed.bytes > 0 { AHEAD_OF_UNKNOWN } else { 0 };
        let Err(used) = claimed.take(used, bytes.saturating_add(ahead)).or_else(|_| claimed.take(used, bytes)) else {
            return Ok(());
        };
        if let Some(key) = &claimed.key
            && claimed.metadata.by_idempotency_key(key).await?.is_some()
        {
            // an equal request has made the job meanwhile: this one is a repeat and needs no quota
            self.0 = None;
            return Ok(());
        }
        Err(over_quota(bytes, &OverQuota { token: claimed.name.clone(), used, quota: claimed.quota }))
    }
}

impl Claimed {
    /// Sets the claim to `bytes`. `Err`: the bytes in use by others, which leave too little.
    fn take(&mut self, stored: u64, bytes: u64) -> Result<(), u64> {
        self.claims.change(Some(self.token), |all| {
            let others = if self.key.is_some() { 0 } else { *all - self.bytes };
            let used = stored.saturating_add(others);
            if used.saturating_add(bytes) > self.quota {
                return Err(used);
            }
            *all += bytes - self.bytes;
            self.bytes = bytes;
            Ok(())
        })
    }
}

impl Drop for Claimed {
    fn drop(&mut self) {
        self.claims.change(Some(self.token), |all| *all -= self.bytes);
    }
}

/// The error for an upload of `bytes` that exceeds the quota.
pub fn over_quota(bytes: u64, over: &OverQuota) -> ApiError {
    let OverQuota { token, used, quota } = over;
    let detail = format!(
        "the upload exceeds the quota of token '{token}': it needs {bytes} bytes, and {used} of {quota} are used; delete \
         old stacks, or ask for a larger quota"
    );
    ApiError::new(Code::InsufficientStorage, detail)
}
