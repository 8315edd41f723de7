//! Whether the server asks for tokens. Where other machines can reach it, it does, unless somebody says by name that it
//! shall not.

use std::net::IpAddr;

use anyhow::bail;
use clap::ValueEnum;
use serde::{Deserialize, Serialize};

use crate::store::Tokens;

/// Whether tokens are asked for.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Auth {
    /// As soon as one was made, valid or revoked by now, and wherever other machines can reach the server.
    #[default]
    Auto,
    /// Always.
    Tokens,
    /// Never: whoever reaches the port may do everything.
    None,
}

/// Who is asked for a token.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Asked {
    /// Everybody.
    Always,
    /// Nobody, until the first token is made.
    OnceThereAreTokens,
    /// Nobody.
    Never,
}

/// Decides for a server that is about to listen.
///
/// # Errors
/// When other machines could reach it and nobody was told who may use it.
pub async fn asks_for_tokens(auth: Auth, address: IpAddr, tokens: &dyn Tokens) -> anyhow::Result<Asked> {
    match auth {
        Auth::Tokens => Ok(Asked::Always),
        Auth::None => {
            if !address.is_loopback() {
                tracing::warn!(%address, "auth = none: whoever reaches the port may do everything");
            }
            Ok(Asked::Never)
        }
        Auth::Auto => {
            // a revoked one counts too: somebody wanted the door closed, and revoking the last one must not open it
            let tokens = tokens.tokens().await?;
            if !tokens.is_empty() && tokens.iter().all(|token| token.revoked_at.is_some()) {
                tracing::warn!(
                    "every token is revoked, so no request is let in; make one (pinstack token add NAME --scope admin), or \
                     say --auth none if nobody shall be asked"
                );
            }
            if tokens.is_empty() && !address.is_loopback() {
                bail!(
                    "listen: other machines can reach {address}, and there is no token that says who may use the \
                     service; make one (pinstack token add NAME --scope admin), listen on 127.0.0.1, or say --auth none \
                     (PINSTACK_AUTH=none) if something before the server checks who is asking"
                );
            }
            Ok(if tokens.is_empty() { Asked::OnceThereAreTokens } else { Asked::Always })
        }
    }
}
