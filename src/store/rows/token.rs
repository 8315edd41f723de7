//! Rows of tokens.

use anyhow::anyhow;
use uuid::Uuid;

use super::{from_row::from_row, name, time, unsigned};
use crate::store::{
    StoreError, StoreResult,
    tokens::{Scope, Token},
};

/// A row of `tokens`.
pub(in crate::store) struct TokenRow {
    id: Uuid,
    name: String,
    digest: Vec<u8>,
    scopes: String,
    created_at: i64,
    revoked_at: Option<i64>,
    quota_bytes: Option<i64>,
}

from_row!(TokenRow { id, name, digest, scopes, created_at, revoked_at, quota_bytes });

impl TryFrom<TokenRow> for Token {
    type Error = StoreError;

    fn try_from(row: TokenRow) -> StoreResult<Self> {
        let scopes: Result<Vec<Scope>, String> = row.scopes.split_whitespace().map(str::parse).collect();
        Ok(Self {
            id: row.id,
            name: name(row.name)?,
            scopes: scopes.map_err(|e| anyhow!("a row contains an unknown scope: {e}"))?,
            digest: row.digest.try_into().map_err(|_| anyhow!("a row contains a digest of the wrong length"))?,
            quota_bytes: row.quota_bytes.map(unsigned),
            created_at: time(row.created_at)?,
            revoked_at: row.revoked_at.map(time).transpose()?,
        })
    }
}
