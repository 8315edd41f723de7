//! Settings whose value is one of a few words.

use clap::ValueEnum;
use serde::{Deserialize, Serialize};

/// When tokens are required.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Auth {
    /// Once a token exists (valid or revoked), and whenever other machines can reach the server.
    #[default]
    Auto,
    /// Always.
    Tokens,
    /// Never: every client that reaches the port may do everything.
    None,
}

/// Format of the log.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum LogFormat {
    /// For people.
    #[default]
    Text,
    /// One object per line.
    Json,
}
