//! `pinstack token`: creates, lists and revokes access tokens.

use std::path::Path;

use anyhow::{Context, anyhow};
use clap::{Args, Subcommand};

use super::{
    output::{note, say, say_once},
    store::Place,
};
use crate::{
    contract::Name,
    store::{
        MetadataStore,
        backup::remove_mark,
        folder, open_shared_metadata,
        tokens::{NewToken, Scope, mint, names},
    },
};

/// Bytes in a GB.
const GB: u64 = 1_000_000_000;

/// Create, list and revoke access tokens. A server may run meanwhile.
#[derive(Debug, Args)]
pub struct Token {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    place: Place,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Create a token and print it, once
    Add {
        /// Name of the token: 1 to 64 of A-Z a-z 0-9 . _ -
        name: String,
        /// What the token allows: profiles:write, stacks:write, read, admin; may be repeated
        #[arg(long = "scope", value_name = "SCOPE", required = true)]
        scopes: Vec<Scope>,
        /// Disk space that its stacks and uploads may use together, GB (10^9 bytes) [default: no limit]
        #[arg(long, value_name = "GB")]
        quota_gb: Option<u64>,
    },
    /// List the tokens, without their secrets
    List,
    /// Revoke a token at once
    Revoke {
        /// Name of the token
        name: String,
    },
}

impl Token {
    /// Runs the command.
    ///
    /// # Errors
    /// When the name is invalid or taken, or the database cannot be used.
    pub fn run(self) -> anyhow::Result<()> {
        let config = self.place.settings()?;
        let (data_dir, database) = (&config.data_dir, config.database()?);
        folder::make(data_dir).with_context(|| format!("data_dir: cannot create the folder {}", data_dir.display()))?;
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        runtime.block_on(async {
            let metadata = open_shared_metadata(data_dir, database.as_ref()).await?;
            let done = match self.command {
                Command::Add { name, scopes, quota_gb } => add(&*metadata, data_dir, name, scopes, quota_gb).await,
                Command::List => list(&*metadata).await,
                Command::Revoke { name } => revoke(&*metadata, data_dir, name).await,
            };
            metadata.close().await;
            done
        })
    }
}

/// Makes a backup a store of its own: before its tokens are changed, and not when nothing is changed.
fn leave_backup(data_dir: &Path) -> anyhow::Result<()> {
    remove_mark(data_dir).with_context(|| format!("data_dir: cannot write into {}", data_dir.display()))
}

async fn add(
    metadata: &dyn MetadataStore,
    data_dir: &Path,
    name: String,
    scopes: Vec<Scope>,
    quota_gb: Option<u64>,
) -> anyhow::Result<()> {
    let name = Name::new(name)?;
    let taken = || anyhow!("a token '{name}' exists or existed; choose another name");
    if metadata.tokens().await?.iter().any(|token| token.name == name) {
        return Err(taken());
    }
    leave_backup(data_dir)?;
    let (id, secret, text) = mint().context("the operating system provides no random bytes")?;
    let quota_bytes = quota_gb.map(|gb| gb.saturating_mul(GB));
    let token = NewToken { id, name: name.clone(), digest: secret.digest(), scopes, quota_bytes };
    // shown before it is stored: a token that cannot be shown must not exist
    say_once(&text)?;
    if !metadata.add_token(&token).await.context("the token above was not stored and is not valid")? {
        return Err(taken().context("the token above was not stored and is not valid"));
    }
    note("A server on this folder requires tokens from its next request on, unless auth is none.");
    note("The token is shown only this once; the service stores a digest of it.");
    Ok(())
}

async fn list(metadata: &dyn MetadataStore) -> anyhow::Result<()> {
    for token in metadata.tokens().await? {
        let state = token.revoked_at.map(|at| format!("revoked {at:.0}")).unwrap_or_else(|| "valid".to_owned());
        let used = metadata.used_bytes(token.id).await? as f64 / GB as f64;
        let quota = token.quota_bytes.map(|bytes| format!(" of {} GB", bytes / GB)).unwrap_or_else(|| " GB".to_owned());
        let (name, scopes, made) = (&token.name, names(&token.scopes, ","), token.created_at);
        say(format!("{name}\t{scopes}\tmade {made:.0}\t{state}\t{used:.1}{quota} used"));
    }
    Ok(())
}

async fn revoke(metadata: &dyn MetadataStore, data_dir: &Path, name: String) -> anyhow::Result<()> {
    let name = Name::new(name)?;
    let missing = || anyhow!("there is no valid token '{name}'; list the tokens with 'pinstack token list'");
    if !metadata.tokens().await?.iter().any(|token| token.name == name && token.revoked_at.is_none()) {
        return Err(missing());
    }
    leave_backup(data_dir)?;
    metadata.revoke_token(&name).await?.then_some(()).ok_or_else(missing)
}
