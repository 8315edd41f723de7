//! Configuration: flags over `PINSTACK_*` environment over a TOML file over defaults. A bad value is refused with
//! where it came from.

use std::{path::PathBuf, time::Duration};

use anyhow::anyhow;
use clap::ValueEnum;
use figment::{
    Figment, Metadata, Source,
    providers::{Env, Format, Serialized, Toml},
};
use serde::{Deserialize, Serialize};

use super::{access::Auth, environment};
use crate::{http::connections::AddressRange, store::Retention};

/// Where the server listens when nobody says otherwise.
pub const DEFAULT_LISTEN: &str = "127.0.0.1:8080";

/// How the log is written.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum LogFormat {
    /// For people.
    #[default]
    Text,
    /// One object per line.
    Json,
}

/// Everything that `pinstack serve` can be told.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ServeConfig {
    /// Address and port; port 0 takes a free one.
    pub listen: String,
    /// Folder of the database and the files.
    pub data_dir: PathBuf,
    /// Jobs worked on at a time; 0: this process only serves.
    pub workers: usize,
    /// Memory for all running jobs together, MiB.
    pub memory_mb: u64,
    /// A job whose worker is not heard of for so long is taken by another, seconds.
    pub lease_s: u64,
    /// Largest upload, bytes.
    pub max_upload_bytes: u64,
    /// Most jobs that may wait.
    pub queue_limit: u64,
    /// Room that must stay free on the disk, bytes.
    pub min_free_bytes: u64,
    /// Bytes that the uploads in progress of one token reserve ahead of those that have arrived.
    pub upload_reserve_bytes: u64,
    /// Resumable uploads that one token may have open.
    pub max_open_uploads: u64,
    /// An upload that sends nothing for this long is given up, seconds.
    pub body_idle_timeout_s: u64,
    /// A resumable upload waits for its next piece so long, seconds.
    pub upload_keep_s: u64,
    /// Stacks that went well go so many days after their end, unless their own `keep_days` say otherwise.
    pub keep_stacks_days: Option<u32>,
    /// Stacks and calibrations that failed or were cancelled go so many days after their end.
    pub keep_failed_days: Option<u32>,
    /// The zips of stacks and calibrations that went well go so many days after their end; the results stay.
    pub keep_uploads_days: Option<u32>,
    /// Whether tokens are asked for.
    pub auth: Auth,
    /// A token sees only the stacks and uploads that it sent, unless it is an admin's.
    pub isolate_tokens: bool,
    /// Certificate for TLS, PEM; with `tls_key`.
    pub tls_cert: Option<PathBuf>,
    /// Its private key, PEM.
    pub tls_key: Option<PathBuf>,
    /// Most connections at a time; more wait.
    pub max_connections: usize,
    /// A client that takes longer for the head of a request is hung up on, seconds.
    pub header_timeout_s: u64,
    /// Most connections of one address and most requests in progress of one token; a quarter of `max_connections` when unset.
    pub connections_per_client: Option<usize>,
    /// Addresses and ranges of reverse proxies: their connections are not limited by address, and `X-Forwarded-For` of them
    /// counts for the log.
    pub trusted_proxies: Vec<String>,
    /// Names under which browsers may reach a service that asks for no token.
    pub hosts: Vec<String>,
    /// Origins whose pages may use the service from a browser.
    pub cors_origins: Vec<String>,
    /// Log filter: `info`, `debug`, `pinstack=debug,info`, ...
    pub log: String,
    /// How the log is written.
    pub log_format: LogFormat,
    /// The address that the server listens on is written here once it does.
    pub port_file: Option<PathBuf>,
}

/// The same as flags, where nothing means: ask the environment, the file, the defaults.
#[derive(Debug, Clone, Default, clap::Args, Serialize)]
pub struct Flags {
    /// TOML file with any of the settings below, in snake_case [env: PINSTACK_CONFIG]
    #[arg(long, value_name = "FILE")]
    #[serde(skip)]
    pub config: Option<PathBuf>,
    /// Address and port; port 0 takes a free one [default: 127.0.0.1:8080] [env: PINSTACK_LISTEN]
    #[arg(long, value_name = "ADDR")]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub listen: Option<String>,
    /// Folder of the database and the files [default: pinstack-data] [env: PINSTACK_DATA_DIR]
    #[arg(long, value_name = "DIR")]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub data_dir: Option<PathBuf>,
    /// Jobs worked on at a time; 0: only serve [default: 1] [env: PINSTACK_WORKERS]
    #[arg(long, value_name = "N")]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub workers: Option<usize>,
    /// Memory for all running jobs together, MiB [default: 4096] [env: PINSTACK_MEMORY_MB]
    #[arg(long, value_name = "MIB")]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub memory_mb: Option<u64>,
    /// A job whose worker is not heard of for so long is taken by another [default: 15] [env: PINSTACK_LEASE_S]
    #[arg(long, value_name = "SECONDS")]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lease_s: Option<u64>,
    /// Largest upload [default: 64 GiB] [env: PINSTACK_MAX_UPLOAD_BYTES]
    #[arg(long, value_name = "BYTES")]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_upload_bytes: Option<u64>,
    /// Most jobs that may wait [default: 1000] [env: PINSTACK_QUEUE_LIMIT]
    #[arg(long, value_name = "N")]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub queue_limit: Option<u64>,
    /// Room that must stay free on the disk [default: 512 MiB] [env: PINSTACK_MIN_FREE_BYTES]
    #[arg(long, value_name = "BYTES")]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub min_free_bytes: Option<u64>,
    /// Most bytes that the uploads in progress of one token reserve on the disk ahead of those that have arrived [default: 16 GiB] [env: PINSTACK_UPLOAD_RESERVE_BYTES]
    #[arg(long, value_name = "BYTES")]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub upload_reserve_bytes: Option<u64>,
    /// Most resumable uploads that one token may have open [default: 100] [env: PINSTACK_MAX_OPEN_UPLOADS]
    #[arg(long, value_name = "N")]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_open_uploads: Option<u64>,
    /// Give an upload up that sends nothing for so long [default: 60] [env: PINSTACK_BODY_IDLE_TIMEOUT_S]
    #[arg(long, value_name = "SECONDS")]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub body_idle_timeout_s: Option<u64>,
    /// A resumable upload waits for its next piece so long [default: 86400] [env: PINSTACK_UPLOAD_KEEP_S]
    #[arg(long, value_name = "SECONDS")]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub upload_keep_s: Option<u64>,
    /// Remove stacks that went well so many days after their end, unless their own keep_days say otherwise [default: never] [env: PINSTACK_KEEP_STACKS_DAYS]
    #[arg(long, value_name = "DAYS")]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub keep_stacks_days: Option<u32>,
    /// Remove stacks and calibrations that failed or were cancelled so many days after their end [default: never] [env: PINSTACK_KEEP_FAILED_DAYS]
    #[arg(long, value_name = "DAYS")]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub keep_failed_days: Option<u32>,
    /// Remove the zips of stacks and calibrations that went well so many days after their end; the results stay [default: never] [env: PINSTACK_KEEP_UPLOADS_DAYS]
    #[arg(long, value_name = "DAYS")]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub keep_uploads_days: Option<u32>,
    /// Whether tokens are asked for; auto: when there are any, and wherever other machines can reach the server [default: auto] [env: PINSTACK_AUTH]
    #[arg(long, value_name = "WHEN")]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub auth: Option<Auth>,
    /// A token sees only the stacks and uploads that it sent, unless it is an admin's [default: false] [env: PINSTACK_ISOLATE_TOKENS]
    #[arg(long, value_name = "BOOL", num_args = 0..=1, default_missing_value = "true")]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub isolate_tokens: Option<bool>,
    /// Speak TLS, with this certificate (PEM, the chain below it) [env: PINSTACK_TLS_CERT]
    #[arg(long, value_name = "FILE")]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tls_cert: Option<PathBuf>,
    /// Private key of the certificate (PEM) [env: PINSTACK_TLS_KEY]
    #[arg(long, value_name = "FILE")]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tls_key: Option<PathBuf>,
    /// Most connections at a time; more wait [default: 1024] [env: PINSTACK_MAX_CONNECTIONS]
    #[arg(long, value_name = "N")]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_connections: Option<usize>,
    /// Hang up on a client that takes longer for the head of a request [default: 20] [env: PINSTACK_HEADER_TIMEOUT_S]
    #[arg(long, value_name = "SECONDS")]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub header_timeout_s: Option<u64>,
    /// Most connections of one address, and most requests in progress of one token [default: a quarter of max_connections] [env: PINSTACK_CONNECTIONS_PER_CLIENT]
    #[arg(long, value_name = "N")]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub connections_per_client: Option<usize>,
    /// Address or range (10.0.0.0/8) of a reverse proxy: its connections are not limited by address; may be given several times [default: 127.0.0.0/8, ::1] [env: PINSTACK_TRUSTED_PROXIES, as ["..."]]
    #[arg(long = "trusted-proxy", value_name = "ADDRESS")]
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub trusted_proxies: Vec<String>,
    /// Name under which browsers may reach a service that asks for no token, beside localhost and its address; may be given several times [default: none] [env: PINSTACK_HOSTS, as ["..."]]
    #[arg(long = "host", value_name = "NAME")]
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub hosts: Vec<String>,
    /// Origin whose pages may use the service from a browser, https://lab.example say; may be given several times [default: none] [env: PINSTACK_CORS_ORIGINS, as ["..."]]
    #[arg(long = "cors-origin", value_name = "ORIGIN")]
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub cors_origins: Vec<String>,
    /// Log filter [default: info] [env: PINSTACK_LOG]
    #[arg(long, value_name = "FILTER")]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub log: Option<String>,
    /// How the log is written [default: text] [env: PINSTACK_LOG_FORMAT]
    #[arg(long, value_name = "FORMAT")]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub log_format: Option<LogFormat>,
    /// Write the address that is listened on into this file [env: PINSTACK_PORT_FILE]
    #[arg(long, value_name = "FILE")]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub port_file: Option<PathBuf>,
}

impl Default for ServeConfig {
    fn default() -> Self {
        let policy = crate::http::Policy::default();
        Self {
            listen: DEFAULT_LISTEN.to_owned(),
            data_dir: PathBuf::from("pinstack-data"),
            workers: 1,
            memory_mb: 4096,
            lease_s: crate::worker::Config::default().lease.as_secs(),
            max_upload_bytes: policy.max_upload_bytes,
            queue_limit: policy.queue_limit,
            min_free_bytes: policy.min_free_bytes,
            upload_reserve_bytes: policy.upload_reserve_bytes,
            max_open_uploads: policy.max_open_uploads,
            body_idle_timeout_s: policy.body_idle_timeout.as_secs(),
            upload_keep_s: policy.upload_keep.as_secs(),
            keep_stacks_days: None,
            keep_failed_days: None,
            keep_uploads_days: None,
            auth: Auth::default(),
            isolate_tokens: false,
            tls_cert: None,
            tls_key: None,
            max_connections: policy.max_connections,
            header_timeout_s: policy.header_timeout.as_secs(),
            connections_per_client: None,
            trusted_proxies: vec!["127.0.0.0/8".to_owned(), "::1".to_owned()],
            hosts: policy.hosts,
            cors_origins: policy.cors_origins,
            log: "info".to_owned(),
            log_format: LogFormat::Text,
            port_file: None,
        }
    }
}

/// Names of the settings, as the file spells them.
const KEYS: [&str; 28] = [
    "listen",
    "data_dir",
    "workers",
    "memory_mb",
    "lease_s",
    "max_upload_bytes",
    "queue_limit",
    "min_free_bytes",
    "upload_reserve_bytes",
    "max_open_uploads",
    "body_idle_timeout_s",
    "upload_keep_s",
    "keep_stacks_days",
    "keep_failed_days",
    "keep_uploads_days",
    "auth",
    "isolate_tokens",
    "tls_cert",
    "tls_key",
    "max_connections",
    "header_timeout_s",
    "connections_per_client",
    "trusted_proxies",
    "hosts",
    "cors_origins",
    "log",
    "log_format",
    "port_file",
];

impl ServeConfig {
    /// Puts the sources together.
    ///
    /// # Errors
    /// When a value is of the wrong kind or breaks its rule, or the file or the environment has a key that is none: says
    /// which, and where it came from.
    pub fn load(flags: &Flags) -> anyhow::Result<Self> {
        environment::check(std::env::vars_os().filter_map(|(name, _)| name.into_string().ok()), &KEYS)?;
        let mut figment = Figment::from(Serialized::defaults(Self::default()));
        let file = flags.config.clone().or_else(|| std::env::var_os("PINSTACK_CONFIG").map(PathBuf::from));
        if let Some(file) = file {
            if !file.is_file() {
                return Err(anyhow!("there is no configuration file {}", file.display()));
            }
            figment = figment.merge(Toml::file_exact(file));
        }
        let figment = figment.merge(Env::prefixed("PINSTACK_").only(&KEYS)).merge(Serialized::globals(flags));
        let config: Self = figment.extract().map_err(|error| {
            let key = error.path.join(".");
            let place = error.metadata.as_ref().map(|m| origin(m, &key)).unwrap_or_default();
            let key = if key.is_empty() { key } else { format!("{key}: ") };
            anyhow!("{key}{}{place}", error.kind)
        })?;
        config.check(&figment)?;
        Ok(config)
    }

    /// How long what has ended is kept.
    pub fn retention(&self) -> Retention {
        let days = |days: Option<u32>| days.map(|days| Duration::from_secs(u64::from(days) * 24 * 60 * 60));
        Retention {
            stacks: days(self.keep_stacks_days),
            failed: days(self.keep_failed_days),
            uploads: days(self.keep_uploads_days),
        }
    }

    fn check(&self, figment: &Figment) -> anyhow::Result<()> {
        let rules = [
            ("listen", self.listen.contains(':'), "must be an address and a port, 127.0.0.1:8080 say"),
            ("workers", self.workers <= 256, "must be 0 to 256"),
            ("memory_mb", (64..=16 << 20).contains(&self.memory_mb), "must be 64 to 16777216 MiB"),
            ("lease_s", (2..=3600).contains(&self.lease_s), "must be 2 to 3600"),
            ("max_upload_bytes", self.max_upload_bytes >= 1024, "must be at least 1024"),
            ("queue_limit", self.queue_limit >= 1, "must be at least 1"),
            ("max_open_uploads", self.max_open_uploads >= 1, "must be at least 1"),
            ("body_idle_timeout_s", (1..=86_400).contains(&self.body_idle_timeout_s), "must be 1 to 86400"),
            (
                "tls_cert",
                self.tls_cert.is_some() == self.tls_key.is_some(),
                "and tls_key belong together: give both or none",
            ),
            ("max_connections", (1..=1_000_000).contains(&self.max_connections), "must be 1 to 1000000"),
            ("header_timeout_s", (1..=3600).contains(&self.header_timeout_s), "must be 1 to 3600"),
            (
                "connections_per_client",
                self.connections_per_client.is_none_or(|most| (1..=self.max_connections).contains(&most)),
                "must be 1 to max_connections",
            ),
            (
                "trusted_proxies",
                self.trusted_proxies.iter().all(|range| range.parse::<AddressRange>().is_ok()),
                "must be addresses or ranges of them: 172.18.0.2 or 10.0.0.0/8",
            ),
            (
                "hosts",
                self.hosts.iter().all(|host| is_host(host)),
                "must be names as they stand in a URL, lab-pc.example say: no scheme, no port, no path",
            ),
            (
                "cors_origins",
                self.cors_origins.iter().all(|origin| is_origin(origin)),
                "must be origins as browsers send them: https://lab.example or http://localhost:3000, no path, no *",
            ),
            ("upload_keep_s", (60..=31_536_000).contains(&self.upload_keep_s), "must be 60 to 31536000"),
        ];
        for (key, holds, rule) in rules {
            if !holds {
                let place = figment.find_metadata(key).map(|m| origin(m, key)).unwrap_or_default();
                return Err(anyhow!("{key} {rule}{place}"));
            }
        }
        Ok(())
    }
}

/// Scheme and host, perhaps a port, and nothing behind.
fn is_origin(text: &str) -> bool {
    let host = text.strip_prefix("https://").or_else(|| text.strip_prefix("http://"));
    host.is_some_and(|host| {
        !host.is_empty() && host.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b"-.:[]".contains(&b))
    })
}

/// A name without anything around it.
fn is_host(text: &str) -> bool {
    !text.is_empty() && text.bytes().all(|b| b.is_ascii_alphanumeric() || b"-._".contains(&b))
}

/// Where a value came from, for the end of a sentence.
fn origin(metadata: &Metadata, key: &str) -> String {
    if metadata.name.contains("environment") {
        return format!(" (environment variable PINSTACK_{})", key.to_uppercase());
    }
    match &metadata.source {
        Some(Source::File(path)) => format!(" (file {}, key {key})", path.display()),
        // flags that are given several times name one thing
        _ => match key {
            "cors_origins" => " (flag --cors-origin)".to_owned(),
            "hosts" => " (flag --host)".to_owned(),
            "trusted_proxies" => " (flag --trusted-proxy)".to_owned(),
            key => format!(" (flag --{})", key.replace('_', "-")),
        },
    }
}
