//! Whether the server requires tokens. It does whenever other machines can reach it, unless `auth = none` is set.

use std::net::IpAddr;

use anyhow::bail;

use crate::{settings::Auth, store::Tokens};

/// Whether a listening server requires tokens.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TokensRequired {
    /// From every request.
    Always,
    /// Once the first token exists.
    OnceThereAreTokens,
    /// Never.
    Never,
}

/// Decides for a server that is about to listen on `address`.
///
/// # Errors
/// With `auth = auto`, when other machines could reach the server and no token exists.
pub async fn tokens_required(auth: Auth, address: IpAddr, tokens: &dyn Tokens) -> anyhow::Result<TokensRequired> {
    match auth {
        Auth::Tokens => Ok(TokensRequired::Always),
        Auth::None => {
            if !address.is_loopback() {
                tracing::warn!(%address, "auth = none: every client that reaches the port may do everything");
            }
            Ok(TokensRequired::Never)
        }
        Auth::Auto => {
            // revoked tokens count too: revoking the last token must not open the service
            let tokens = tokens.tokens().await?;
            if !tokens.is_empty() && tokens.iter().all(|token| token.revoked_at.is_some()) {
                tracing::warn!(
                    "every token is revoked, so every request is refused; make a token (pinstack token add NAME --scope admin), \
                     or set --auth none to require none"
                );
            }
            if tokens.is_empty() && !address.is_loopback() {
                bail!(
                    "listen: other machines can reach {address}, and no token exists; make a token (pinstack token add \
                     NAME --scope admin), listen on 127.0.0.1, or set --auth none (PINSTACK_AUTH=none) if a proxy \
                     authenticates the clients"
                );
            }
            Ok(if tokens.is_empty() { TokensRequired::OnceThereAreTokens } else { TokensRequired::Always })
        }
    }
}
