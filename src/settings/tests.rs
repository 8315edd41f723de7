use std::{fs, path::Path};

use serde_json::json;

use super::{
    rules::is_base_url,
    table::{ROWS, Settings},
};

/// The head of the table in `docs/SETTINGS.md`, which ends with an empty line.
const HEAD: &str = "| flag | variable | default | meaning |\n|---|---|---|---|\n";

#[test]
fn the_table_of_the_documentation_is_that_of_the_program() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/SETTINGS.md");
    let document = fs::read_to_string(&file).expect("UTF-8");
    let (before, rest) = document.split_once(HEAD).expect("the head of the table");
    let after = &rest[rest.find("\n\n").expect("an empty line") + 1..];
    let defaults = serde_json::to_value(Settings::default()).expect("JSON");
    let rows: String = ROWS.iter().map(|row| row.markdown(&defaults)).collect();
    let right = [before, HEAD, &rows, after].concat();
    if std::env::var_os("PINSTACK_TEST_WRITE").is_some() {
        fs::write(&file, right).expect("written");
    } else {
        assert!(document == right, "run PINSTACK_TEST_WRITE=1 cargo test --lib settings to write the table");
    }
}

#[test]
fn the_defaults_keep_their_rules() {
    assert_eq!(Settings::default().violation(), None);
}

#[test]
fn the_first_broken_rule_is_reported_with_its_key() {
    let settings = Settings { workers: 257, ..Settings::default() };
    assert_eq!(settings.violation(), Some(("workers", "must be 0 to 256".to_owned())));
    let settings = Settings { storage_presigned_s: 60, ..Settings::default() };
    assert_eq!(settings.violation(), Some(("storage_presigned_s", "needs storage_url".to_owned())));
    let settings = Settings { queue_limit: 0, ..Settings::default() };
    assert_eq!(settings.violation(), Some(("queue_limit", "must be at least 1".to_owned())));
}

#[test]
fn a_base_url_has_neither_user_nor_query() {
    for url in ["http://127.0.0.1:4318", "https://otel.lab.example", "https://lab.example/otlp/"] {
        assert!(is_base_url(url), "{url}");
    }
    for url in ["", "127.0.0.1:4318", "grpc://lab:4317", "http://", "http://a:b@lab", "http://lab/?x", "http://lab/#x"]
    {
        assert!(!is_base_url(url), "{url}");
    }
}

#[test]
fn the_help_shows_default_and_variable() {
    let defaults = json!({"max_upload_bytes": 64_u64 << 30, "hosts": []});
    for (key, flag, shown) in [
        ("max_upload_bytes", "max-upload-bytes", "[default: 64 GiB] [env: PINSTACK_MAX_UPLOAD_BYTES]"),
        ("keep_stacks_days", "keep-stacks-days", "[default: never] [env: PINSTACK_KEEP_STACKS_DAYS]"),
        ("tls_cert", "tls-cert", "(PEM) [env: PINSTACK_TLS_CERT]"),
        ("hosts", "host", "[default: none] [env: PINSTACK_HOSTS, as [\"...\"]]"),
    ] {
        let row = ROWS.iter().find(|row| row.key == key).expect("a row");
        let help = row.help(&defaults);
        assert!(help.ends_with(shown), "{help}");
        assert_eq!(row.flag(), flag);
    }
}
