//! Whether the server asks for tokens. Where other machines can reach it, it does, unless somebody says by name that it
//! shall not.

use std::net::IpAddr;

use anyhow::bail;
use clap::ValueEnum;
use serde::{Deserialize, Serialize};

use crate::store::tokens::TokenRows;

/// Whether tokens are asked for.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Auth {
    /// When there are any, and wherever other machines can reach the server.
    #[default]
    Auto,
    /// Always.
    Tokens,
    /// Never: whoever reaches the port may do everything.
    None,
}

/// Decides for a server that is about to listen.
///
/// # Errors
/// When other machines could reach it and nobody was told who may use it.
pub async fn asks_for_tokens(auth: Auth, address: IpAddr, rows: &dyn TokenRows) -> anyhow::Result<bool> {
    match auth {
        Auth::Tokens => Ok(true),
        Auth::None => {
            if !address.is_loopback() {
                tracing::warn!(%address, "auth = none: whoever reaches the port may do everything");
            }
            Ok(false)
        }
        Auth::Auto => {
            let has_tokens = rows.tokens().await?.iter().any(|token| token.revoked_at.is_none());
            if !has_tokens && !address.is_loopback() {
                bail!(
                    "listen: other machines can reach {address}, and there is no token that says who may use the \
                     service; make one (pinstack token add NAME --scope admin), listen on 127.0.0.1, or say --auth none \
                     (PINSTACK_AUTH=none) if something before the server checks who is asking"
                );
            }
            Ok(has_tokens)
        }
    }
}
