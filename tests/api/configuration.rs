use std::{path::Path, process::Command};

/// The error output of `pinstack serve` when it refuses its configuration.
fn refusal(folder: &Path, arguments: &[&str], environment: &[(&str, &str)]) -> String {
    let mut command = Command::new(env!("CARGO_BIN_EXE_pinstack"));
    command.current_dir(folder).arg("serve").args(arguments).envs(environment.iter().copied());
    let output = command.output().expect("the program runs");
    assert!(!output.status.success());
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn a_bad_value_is_refused_with_its_source_and_the_strongest_source_wins() {
    let folder = tempfile::TempDir::new().expect("a folder");
    std::fs::write(folder.path().join("p.toml"), "workers = 997\n").expect("a file");
    let file = ["--config", "p.toml"];
    let told = refusal(folder.path(), &file, &[]);
    assert!(told.contains("workers must be 0 to 256") && told.contains("p.toml, key workers"), "{told}");

    let environment = [("PINSTACK_WORKERS", "998")];
    let told = refusal(folder.path(), &file, &environment);
    assert!(told.contains("environment variable PINSTACK_WORKERS"), "{told}");

    let told = refusal(folder.path(), &["--config", "p.toml", "--workers", "999"], &environment);
    assert!(told.contains("(flag --workers)"), "{told}");
}

#[test]
fn a_value_of_the_wrong_kind_and_an_unknown_key_are_refused() {
    let folder = tempfile::TempDir::new().expect("a folder");
    let told = refusal(folder.path(), &[], &[("PINSTACK_MEMORY_MB", "lots")]);
    assert!(told.contains("memory_mb") && told.contains("PINSTACK_MEMORY_MB"), "{told}");
    std::fs::write(folder.path().join("p.toml"), "wrokers = 2\n").expect("a file");
    let told = refusal(folder.path(), &["--config", "p.toml"], &[]);
    assert!(told.contains("wrokers") && told.contains("p.toml"), "{told}");
    let told = refusal(folder.path(), &["--config", "missing.toml"], &[]);
    assert!(told.contains("missing.toml"), "{told}");
}

#[test]
fn a_file_in_another_encoding_or_form_is_refused_and_named() {
    let folder = tempfile::TempDir::new().expect("a folder");
    let utf16: Vec<u8> = "\u{feff}workers = 2".encode_utf16().flat_map(u16::to_le_bytes).collect();
    for bytes in [utf16.as_slice(), b"# K\xe4fer"] {
        std::fs::write(folder.path().join("p.toml"), bytes).expect("a file");
        let told = refusal(folder.path(), &["--config", "p.toml"], &[]);
        assert!(told.contains("the configuration file p.toml is not in UTF-8; save it as UTF-8"), "{told}");
    }
    std::fs::write(folder.path().join("p.toml"), "workers = “2”").expect("a file");
    let told = refusal(folder.path(), &["--config", "p.toml"], &[]);
    assert!(told.contains("p.toml)") && !told.contains("key "), "{told}");
}

#[test]
fn an_unknown_variable_is_refused_with_a_suggestion() {
    let folder = tempfile::TempDir::new().expect("a folder");
    let told = refusal(folder.path(), &[], &[("PINSTACK_AUTHH", "tokens")]);
    assert!(told.contains("PINSTACK_AUTHH is not a setting; did you mean PINSTACK_AUTH?"), "{told}");
}

#[test]
fn invalid_names_and_addresses_are_refused() {
    let folder = tempfile::TempDir::new().expect("a folder");
    for host in ["", "http://lab.example", "lab.example:80", "lab.example/"] {
        let told = refusal(folder.path(), &["--host", host], &[]);
        assert!(told.contains("hosts must be names") && told.contains("(flag --host)"), "{told}");
    }
    let told = refusal(folder.path(), &[], &[("PINSTACK_TRUSTED_PROXIES", "[\"10.0.0.0/99\"]")]);
    assert!(told.contains("trusted_proxies must be addresses") && told.contains("PINSTACK_TRUSTED_PROXIES"), "{told}");
    let told = refusal(folder.path(), &["--max-connections", "10", "--connections-per-client", "11"], &[]);
    assert!(told.contains("connections_per_client must be 1 to max_connections"), "{told}");
}

#[test]
fn an_origin_that_no_browser_would_send_is_refused() {
    let folder = tempfile::TempDir::new().expect("a folder");
    for origin in ["*", "lab.example", "https://lab.example/", "https://Lab.example", "https://"] {
        let told = refusal(folder.path(), &["--cors-origin", origin], &[]);
        assert!(told.contains("cors_origins must be origins") && told.contains("https://lab.example"), "{told}");
    }
}

#[test]
fn the_program_prints_the_contract_and_reports_health_by_its_exit_code() {
    let output = Command::new(env!("CARGO_BIN_EXE_pinstack")).arg("openapi").output().expect("the program runs");
    assert_eq!(String::from_utf8_lossy(&output.stdout), pinstack::http::router::DOCUMENT.text());
    // nothing listens on port 1
    let health = Command::new(env!("CARGO_BIN_EXE_pinstack")).args(["health", "http://127.0.0.1:1"]).output();
    assert!(!health.expect("the program runs").status.success());
}
