//! The table of settings of `pinstack serve`.
//!
//! One row per setting: key, type, default, name of the value in `--help`, help text, range or rule. [`ServeConfig`],
//! its defaults, [`Flags`], the keys of the file, the environment variables (`PINSTACK_` and the key) and the checks
//! all follow from the row. `tests/docs.rs` compares the flags with the table in `docs/OPERATIONS.md`.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::{access::Auth, environment::PREFIX, logging::LogFormat};
use crate::{
    http::{Policy, connections::AddressRange},
    store::{DatabaseUrl, s3::S3Url},
    worker,
};

/// Default address of the server.
pub const DEFAULT_LISTEN: &str = "127.0.0.1:8080";

/// Generates the configuration, the flags and the checks from the table. `values` have a default, `optional` settings
/// may be unset (the text says what happens then), `lists` are flags that may be given several times.
macro_rules! settings {
    (
        values { $(
            $key:ident: $type:ty = $default:expr, $value_name:literal, $help:literal
                $(, in $least:literal ..= $most:literal)?
                $(, at_least $low:literal)?
                $(, check $holds:expr => $rule:literal)?
                $(, clap($($clap:tt)*))?;
        )* }
        optional { $(
            $o_key:ident: $o_type:ty, $unset:literal, $o_value_name:literal, $o_help:literal
                $(, check $o_holds:expr => $o_rule:literal)?;
        )* }
        lists { $(
            $l_key:ident = $l_default:expr, $l_flag:literal, $l_value_name:literal, $l_help:literal,
                check $l_holds:expr => $l_rule:literal;
        )* }
    ) => {
        /// The settings of a server.
        // the help texts are for terminals, which show addresses as they are
        #[allow(rustdoc::bare_urls)]
        #[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
        #[serde(deny_unknown_fields)]
        pub struct ServeConfig {
            $(#[doc = $help] pub $key: $type,)*
            $(#[doc = $o_help] pub $o_key: Option<$o_type>,)*
            $(#[doc = $l_help] pub $l_key: Vec<String>,)*
        }

        impl Default for ServeConfig {
            fn default() -> Self {
                Self { $($key: $default,)* $($o_key: None,)* $($l_key: $l_default,)* }
            }
        }

        /// The settings as flags. One that is not given is taken from the environment, the file or the defaults.
        #[derive(Debug, Clone, Default, clap::Args, Serialize)]
        pub struct Flags {
            /// TOML file with any of the settings below, in snake_case [env: PINSTACK_CONFIG]
            #[arg(long, value_name = "FILE")]
            #[serde(skip)]
            pub(super) config: Option<PathBuf>,
            $(
                #[arg(long, value_name = $value_name, help = help(stringify!($key), $help, "") $(, $($clap)*)?)]
                #[serde(skip_serializing_if = "Option::is_none")]
                pub(super) $key: Option<$type>,
            )*
            $(
                #[arg(long, value_name = $o_value_name, help = help(stringify!($o_key), $o_help, $unset))]
                #[serde(skip_serializing_if = "Option::is_none")]
                pub(super) $o_key: Option<$o_type>,
            )*
            $(
                #[arg(long = $l_flag, value_name = $l_value_name, help = help(stringify!($l_key), $l_help, ""))]
                #[serde(skip_serializing_if = "Vec::is_empty")]
                pub(super) $l_key: Vec<String>,
            )*
        }

        /// The keys of all settings, as in the file.
        pub(super) const KEYS: &[&str] =
            &[$(stringify!($key),)* $(stringify!($o_key),)* $(stringify!($l_key),)*];

        /// The flag of a setting, without the dashes.
        pub(super) fn flag(key: &str) -> String {
            let lists = [$((stringify!($l_key), $l_flag)),*];
            let list = lists.iter().find(|(list, _)| *list == key);
            list.map_or_else(|| key.replace('_', "-"), |(_, flag)| (*flag).to_owned())
        }

        impl ServeConfig {
            /// Key and rule of the first setting that breaks its rule.
            pub(super) fn violation(&self) -> Option<(&'static str, String)> {
                let rules: Vec<(&'static str, bool, String)> = vec![
                    $($((
                        stringify!($key),
                        ($least..=$most).contains(&self.$key),
                        format!("must be {} to {}", $least, $most),
                    ),)?)*
                    $($((stringify!($key), self.$key >= $low, format!("must be at least {}", $low)),)?)*
                    $($(rule(self, stringify!($key), $holds, $rule),)?)*
                    $($(rule(self, stringify!($o_key), $o_holds, $o_rule),)?)*
                    $(rule(self, stringify!($l_key), $l_holds, $l_rule),)*
                ];
                rules.into_iter().find(|(_, holds, _)| !holds).map(|(key, _, rule)| (key, rule))
            }
        }
    };
}

settings! {
    values {
        listen: String = DEFAULT_LISTEN.to_owned(), "ADDR",
            "Address and port to listen on; port 0 takes a free port",
            check |config| config.listen.contains(':') => "must be an address and a port, for example 127.0.0.1:8080";
        data_dir: PathBuf = PathBuf::from("pinstack-data"), "DIR",
            "Folder of the database and the files";
        workers: usize = 1, "N",
            "Jobs that run at the same time; 0: serve the API only",
            in 0..=256;
        memory_mb: u64 = 4096, "MIB",
            "Memory budget of all running jobs together, MiB",
            in 64..=16_777_216;
        lease_s: u64 = worker::Config::default().lease.as_secs(), "SECONDS",
            "Time without a heartbeat of its worker after which a job is taken over by another worker, seconds",
            in 2..=3600;
        max_upload_bytes: u64 = http().max_upload_bytes, "BYTES",
            "Largest upload, bytes",
            at_least 1024;
        max_scan_bytes: u64 = http().max_scan_bytes, "BYTES",
            "Largest upload with all views of a scan, bytes",
            at_least 1024;
        queue_limit: u64 = http().queue_limit, "N",
            "Largest number of queued jobs",
            at_least 1;
        min_free_bytes: u64 = http().min_free_bytes, "BYTES",
            "Disk space that must stay free, bytes";
        upload_reserve_bytes: u64 = http().upload_reserve_bytes, "BYTES",
            "Disk space that the open uploads of one token may reserve ahead of their bytes";
        max_open_uploads: u64 = http().max_open_uploads, "N",
            "Largest number of open resumable uploads per token",
            at_least 1;
        body_idle_timeout_s: u64 = http().body_idle_timeout.as_secs(), "SECONDS",
            "Timeout of a request body from which no data arrives, seconds",
            in 1..=86_400;
        upload_keep_s: u64 = http().upload_keep.as_secs(), "SECONDS",
            "Time after which a resumable upload without new data expires, seconds",
            in 60..=31_536_000;
        auth: Auth = Auth::default(), "WHEN",
            "When tokens are required; auto: once a token exists, and whenever other machines can reach the server";
        isolate_tokens: bool = false, "BOOL",
            "Show a token only the stacks, scans and uploads that it sent; tokens with the scope admin see all",
            clap(num_args = 0..=1, default_missing_value = "true");
        max_connections: usize = http().max_connections, "N",
            "Largest number of connections; more have to wait",
            in 1..=1_000_000;
        header_timeout_s: u64 = http().header_timeout.as_secs(), "SECONDS",
            "Time within which the head of a request must arrive, and idle time after which a connection is closed, seconds",
            in 1..=3600;
        storage_presigned_s: u64 = 0, "SECONDS",
            "How long a signed URL of a file in the bucket is valid, for clients that ask for a redirect to it; 0: none, seconds",
            in 0..=604_800,
            check |config| config.storage_presigned_s == 0 || config.storage_url.is_some() => "needs storage_url";
        log: String = "info".to_owned(), "FILTER",
            "Log filter: info, debug, or per module as in pinstack=debug,info";
        log_format: LogFormat = LogFormat::Text, "FORMAT",
            "Format of the log";
    }
    optional {
        database_url: DatabaseUrl, "SQLite in data_dir", "URL",
            "Postgres database of a service of several machines, postgres://user:password@host/name; other users of the \
             machine can read flags, so give it in the environment, in the file, or with database_url_file",
            check |config| config.database_url.as_ref().is_none_or(DatabaseUrl::is_valid)
                => "must be a URL of Postgres, for example postgres://user:password@host:5432/pinstack";
        database_url_file: PathBuf, "", "FILE",
            "File that contains the database_url, for example a secret of a container",
            check |config| config.database_url.is_none() || config.database_url_file.is_none()
                => "and database_url exclude each other: give one of them";
        storage_url: S3Url, "files in data_dir", "URL",
            "Bucket of an S3-compatible store for uploads and results, s3://bucket/prefix; needs database_url",
            check |config| config.storage_url.as_ref().is_none_or(|url|
                url.is_valid() && (config.database_url.is_some() || config.database_url_file.is_some()))
                => "must look like s3://bucket or s3://bucket/prefix, and needs database_url";
        storage_endpoint: String, "AWS", "URL",
            "Server of the bucket, for example https://s3.lab.example:9000",
            check |config| config.storage_endpoint.as_ref().is_none_or(|url| is_origin(url.trim_end_matches('/')))
                => "must be scheme, host and port of a server: https://s3.lab.example:9000";
        storage_region: String, "AWS_REGION, or us-east-1", "NAME",
            "Region of the bucket";
        storage_ca_file: PathBuf, "", "FILE",
            "Certificates (PEM) to trust for the server of the bucket, besides those of public authorities";
        storage_credentials_file: PathBuf, "AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or the role of the machine", "FILE",
            "File with the key of the bucket, as ~/.aws/credentials: lines aws_access_key_id and aws_secret_access_key";
        otlp_endpoint: String, "off", "URL",
            "Export traces to this collector of OpenTelemetry (OTLP over HTTP), for example http://127.0.0.1:4318",
            check |config| config.otlp_endpoint.as_ref().is_none_or(|url| is_base_url(url))
                => "must be the URL of a collector without a query, for example http://127.0.0.1:4318; /v1/traces is added";
        otlp_ca_file: PathBuf, "", "FILE",
            "Certificates (PEM) to trust for the collector, besides those of public authorities";
        keep_stacks_days: u32, "never", "DAYS",
            "Delete succeeded stacks this many days after their end, unless their own keep_days differs";
        keep_failed_days: u32, "never", "DAYS",
            "Delete failed and cancelled stacks and calibrations this many days after their end";
        keep_uploads_days: u32, "never", "DAYS",
            "Delete the zips of succeeded stacks and calibrations this many days after their end; the results remain";
        tls_cert: PathBuf, "", "FILE",
            "Serve TLS with this certificate, followed by its chain (PEM)",
            check |config| config.tls_cert.is_some() == config.tls_key.is_some()
                => "and tls_key belong together: give both or none";
        tls_key: PathBuf, "", "FILE",
            "Private key of the certificate (PEM)";
        connections_per_client: usize, "a quarter of max_connections", "N",
            "Largest number of connections per address, and of requests in progress per token",
            check |config| config.connections_per_client.is_none_or(|most| (1..=config.max_connections).contains(&most))
                => "must be 1 to max_connections";
        port_file: PathBuf, "", "FILE",
            "Write the address to this file once the server listens";
    }
    lists {
        trusted_proxies = vec!["127.0.0.0/8".to_owned(), "::1".to_owned()], "trusted-proxy", "ADDRESS",
            "Address or range (10.0.0.0/8) of a reverse proxy: its connections are not limited per address, and its \
             X-Forwarded-For is logged; may be given several times",
            check |config| config.trusted_proxies.iter().all(|range| range.parse::<AddressRange>().is_ok())
                => "must be addresses or ranges of them: 172.18.0.2 or 10.0.0.0/8";
        hosts = http().hosts, "host", "NAME",
            "Host name under which browsers may use a service that requires no token, besides localhost and its address; may \
             be given several times",
            check |config| config.hosts.iter().all(|host| is_host(host))
                => "must be names as in a URL, for example lab-pc.example: no scheme, no port, no path";
        cors_origins = http().cors_origins, "cors-origin", "ORIGIN",
            "Origin whose pages may use the service from a browser, for example https://lab.example; may be given several \
             times",
            check |config| config.cors_origins.iter().all(|origin| is_origin(origin))
                => "must be origins as browsers send them: https://lab.example or http://localhost:3000, no path, no *";
    }
}

/// The defaults of the HTTP layer, which are also those of their settings.
fn http() -> Policy {
    Policy::default()
}

/// One row of the checks. A function, so that the closures of the table get their types.
fn rule(
    config: &ServeConfig,
    key: &'static str,
    holds: fn(&ServeConfig) -> bool,
    rule: &str,
) -> (&'static str, bool, String) {
    (key, holds(config), rule.to_owned())
}

/// The help of a flag: its text, its default and its environment variable. `unset` describes what an unset option does.
fn help(key: &str, text: &str, unset: &str) -> String {
    let defaults = serde_json::to_value(ServeConfig::default()).unwrap_or_default();
    let mut format_of_lists = "";
    let default = match &defaults[key] {
        Value::Null => unset.to_owned(),
        Value::String(text) => text.clone(),
        Value::Number(number) if key.ends_with("_bytes") => in_bytes(number.as_u64().unwrap_or_default()),
        Value::Array(items) => {
            format_of_lists = ", as [\"...\"]";
            let items: Vec<&str> = items.iter().filter_map(Value::as_str).collect();
            if items.is_empty() { "none".to_owned() } else { items.join(", ") }
        }
        other => other.to_string(),
    };
    let default = if default.is_empty() { default } else { format!(" [default: {default}]") };
    format!("{text}{default} [env: {PREFIX}{}{format_of_lists}]", key.to_uppercase())
}

/// A number of bytes in the largest unit that divides it.
fn in_bytes(bytes: u64) -> String {
    [(30, "GiB"), (20, "MiB")]
        .into_iter()
        .find(|(shift, _)| bytes > 0 && bytes.is_multiple_of(1 << shift))
        .map_or_else(|| bytes.to_string(), |(shift, unit)| format!("{} {unit}", bytes >> shift))
}

/// Scheme and host, optionally a port, and nothing else.
fn is_origin(text: &str) -> bool {
    let host = text.strip_prefix("https://").or_else(|| text.strip_prefix("http://"));
    host.is_some_and(|host| {
        !host.is_empty() && host.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b"-.:[]".contains(&b))
    })
}

/// Scheme and host, optionally a port and a path; no user, query or fragment.
fn is_base_url(text: &str) -> bool {
    let Ok(url) = text.parse::<hyper::Uri>() else { return false };
    let is_http = ["http", "https"].contains(&url.scheme_str().unwrap_or_default());
    let host = url.authority().map(hyper::http::uri::Authority::as_str).unwrap_or_default();
    is_http && !host.is_empty() && !host.contains('@') && !text.contains(['?', '#'])
}

/// A host name without scheme, port or path.
fn is_host(text: &str) -> bool {
    !text.is_empty() && text.bytes().all(|b| b.is_ascii_alphanumeric() || b"-._".contains(&b))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_keep_their_rules() {
        assert_eq!(ServeConfig::default().violation(), None);
    }

    #[test]
    fn the_first_broken_rule_is_reported_with_its_key() {
        let config = ServeConfig { workers: 257, ..ServeConfig::default() };
        assert_eq!(config.violation(), Some(("workers", "must be 0 to 256".to_owned())));
        let config = ServeConfig { storage_presigned_s: 60, ..ServeConfig::default() };
        assert_eq!(config.violation(), Some(("storage_presigned_s", "needs storage_url".to_owned())));
        let config = ServeConfig { queue_limit: 0, ..ServeConfig::default() };
        assert_eq!(config.violation(), Some(("queue_limit", "must be at least 1".to_owned())));
    }

    #[test]
    fn a_base_url_has_neither_user_nor_query() {
        for url in ["http://127.0.0.1:4318", "https://otel.lab.example", "https://lab.example/otlp/"] {
            assert!(is_base_url(url), "{url}");
        }
        for url in
            ["", "127.0.0.1:4318", "grpc://lab:4317", "http://", "http://a:b@lab", "http://lab/?x", "http://lab/#x"]
        {
            assert!(!is_base_url(url), "{url}");
        }
    }

    #[test]
    fn the_help_shows_default_and_variable() {
        for (key, unset, shown) in [
            ("max_upload_bytes", "", "[default: 64 GiB] [env: PINSTACK_MAX_UPLOAD_BYTES]"),
            ("keep_stacks_days", "never", "[default: never] [env: PINSTACK_KEEP_STACKS_DAYS]"),
            ("tls_cert", "", "text [env: PINSTACK_TLS_CERT]"),
            ("hosts", "", "[default: none] [env: PINSTACK_HOSTS, as [\"...\"]]"),
        ] {
            let help = help(key, "text", unset);
            assert!(help.ends_with(shown), "{help}");
        }
        assert_eq!((flag("memory_mb").as_str(), flag("hosts").as_str()), ("memory-mb", "host"));
    }
}
