//! Access tokens.
//!
//! A token is `pinstack_{id}_{secret}`. The id selects the row; the row has the SHA-256 of the secret. The secret is
//! shown once, at its creation. It is in no row, no log and no `Debug` output.

use std::{fmt, str::FromStr};

use async_trait::async_trait;
use base64::{Engine, prelude::BASE64_URL_SAFE_NO_PAD};
use jiff::Timestamp;
use sha2::{Digest, Sha256};
use subtle::ConstantTimeEq;
use uuid::Uuid;

use super::StoreResult;
use crate::contract::Name;

/// Prefix of every token, so that secret scanners recognise a leaked one.
const PREFIX: &str = "pinstack_";
/// Length of a secret, bytes.
const SECRET_BYTES: usize = 32;

/// What a token allows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scope {
    /// Write and delete profiles; calibrate.
    ProfilesWrite,
    /// Send, cancel and delete stacks.
    StacksWrite,
    /// Read everything.
    Read,
    /// Everything.
    Admin,
}

impl Scope {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::ProfilesWrite, Self::StacksWrite, Self::Read, Self::Admin];

    /// Name of the scope.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::ProfilesWrite => "profiles:write",
            Self::StacksWrite => "stacks:write",
            Self::Read => "read",
            Self::Admin => "admin",
        }
    }
}

impl FromStr for Scope {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let known = Self::ALL.into_iter().find(|scope| scope.as_str() == text);
        known.ok_or_else(|| format!("unknown scope '{text}'; the scopes are {}", names(&Self::ALL, ", ")))
    }
}

/// The names of scopes.
pub fn names(scopes: &[Scope], between: &str) -> String {
    scopes.iter().map(|scope| scope.as_str()).collect::<Vec<_>>().join(between)
}

/// A stored token.
#[derive(Clone, PartialEq, Eq)]
pub struct Token {
    /// The public part.
    pub id: Uuid,
    /// Name for people.
    pub name: Name,
    /// What it allows.
    pub scopes: Vec<Scope>,
    /// SHA-256 of the secret.
    pub digest: [u8; 32],
    /// Bytes that its stacks and uploads may take together; `None`: no limit.
    pub quota_bytes: Option<u64>,
    /// Time of creation.
    pub created_at: Timestamp,
    /// Time of revocation; `None` while it is valid.
    pub revoked_at: Option<Timestamp>,
}

/// A token that is to be stored.
#[derive(Clone)]
pub struct NewToken {
    /// The public part.
    pub id: Uuid,
    /// Name for people.
    pub name: Name,
    /// SHA-256 of the secret.
    pub digest: [u8; 32],
    /// What it allows.
    pub scopes: Vec<Scope>,
    /// Bytes that its stacks and uploads may take together; `None`: no limit.
    pub quota_bytes: Option<u64>,
}

impl fmt::Debug for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Token({}, {})", self.name, names(&self.scopes, " "))
    }
}

impl Token {
    /// True when it has one of these scopes, or `admin`.
    pub fn allows(&self, any_of: &[Scope]) -> bool {
        self.scopes.iter().any(|scope| *scope == Scope::Admin || any_of.contains(scope))
    }

    /// Whether this is its secret and it is not revoked. Compares in constant time.
    pub fn is_opened_by(&self, secret: &Secret) -> bool {
        self.revoked_at.is_none() && bool::from(self.digest.ct_eq(&secret.digest()))
    }
}

/// The secret part of a token. Its `Debug` output hides it.
pub struct Secret([u8; SECRET_BYTES]);

impl fmt::Debug for Secret {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Secret(..)")
    }
}

impl Secret {
    /// SHA-256 of the secret, as the row has it.
    pub fn digest(&self) -> [u8; 32] {
        Sha256::digest(self.0).into()
    }
}

/// Creates a token: its id, its secret, and the text that is shown once.
///
/// # Errors
/// When the operating system provides no random bytes.
pub fn mint() -> std::io::Result<(Uuid, Secret, String)> {
    let mut bytes = [0; SECRET_BYTES];
    getrandom::fill(&mut bytes).map_err(|error| std::io::Error::other(error.to_string()))?;
    let id = Uuid::now_v7();
    let text = format!("{PREFIX}{}_{}", id.simple(), BASE64_URL_SAFE_NO_PAD.encode(bytes));
    Ok((id, Secret(bytes), text))
}

/// Parses a token; `None` when the text is not a token.
pub fn parse(text: &str) -> Option<(Uuid, Secret)> {
    let (id, secret) = text.strip_prefix(PREFIX)?.split_once('_')?;
    let bytes = BASE64_URL_SAFE_NO_PAD.decode(secret).ok()?;
    Some((Uuid::try_parse(id).ok()?, Secret(bytes.try_into().ok()?)))
}

/// Stores tokens.
#[async_trait]
pub trait Tokens: Send + Sync + 'static {
    /// Stores a token; false when a valid or revoked token has this name.
    async fn add_token(&self, token: &NewToken) -> StoreResult<bool>;
    /// One token, valid or revoked.
    async fn token(&self, id: Uuid) -> StoreResult<Option<Token>>;
    /// All tokens, oldest first.
    async fn tokens(&self) -> StoreResult<Vec<Token>>;
    /// True when there is a token, valid or revoked.
    async fn any_token(&self) -> StoreResult<bool>;
    /// Revokes a token; false when there is no valid token of this name.
    async fn revoke_token(&self, name: &Name) -> StoreResult<bool>;
    /// The token that sent a job or an upload; `None` when it was sent without a token, or does not exist.
    async fn owner(&self, id: Uuid) -> StoreResult<Option<Uuid>>;
    /// Bytes that the stacks, calibrations and open uploads of a token use.
    async fn used_bytes(&self, owner: Uuid) -> StoreResult<u64>;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_is_opened_only_by_its_own_secret_and_never_printed() {
        let (id, secret, text) = mint().expect("random bytes");
        let name = Name::new("night-run").expect("a name");
        let token = Token {
            id,
            name,
            scopes: vec![Scope::Read],
            digest: secret.digest(),
            created_at: Timestamp::UNIX_EPOCH,
            quota_bytes: None,
            revoked_at: None,
        };
        let (read_id, read) = parse(&text).expect("a token");
        assert_eq!(read_id, id);
        assert!(token.is_opened_by(&read));
        assert!(!token.is_opened_by(&mint().expect("random bytes").1));
        let revoked = Token { revoked_at: Some(Timestamp::UNIX_EPOCH), ..token.clone() };
        assert!(!revoked.is_opened_by(&read));
        assert_eq!(format!("{token:?} {read:?}"), "Token(night-run, read) Secret(..)");
        for wrong in ["", "pinstack_", "Bearer x", &text[1..], &text[..text.len() - 1], &format!("{text}A")] {
            assert!(parse(wrong).is_none(), "{wrong}");
        }
    }

    #[test]
    fn admin_allows_everything_and_other_scopes_only_themselves() {
        let with = |scopes: &[Scope]| Token {
            id: Uuid::nil(),
            name: Name::new("x").expect("a name"),
            scopes: scopes.to_vec(),
            digest: [0; 32],
            created_at: Timestamp::UNIX_EPOCH,
            quota_bytes: None,
            revoked_at: None,
        };
        assert!(with(&[Scope::Admin]).allows(&[Scope::ProfilesWrite]));
        assert!(with(&[Scope::Read, Scope::StacksWrite]).allows(&[Scope::ProfilesWrite, Scope::StacksWrite]));
        assert!(!with(&[Scope::Read]).allows(&[Scope::StacksWrite]));
        assert!(!with(&[]).allows(&[Scope::Read]));
        assert_eq!("stacks:write".parse(), Ok(Scope::StacksWrite));
        assert!(
            "stacks".parse::<Scope>().is_err_and(|error| error.contains("profiles:write, stacks:write, read, admin"))
        );
    }
}
