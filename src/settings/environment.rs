//! Checks the environment variables with the prefix `PINSTACK_`: a misspelt setting is refused, not ignored.

use anyhow::bail;

/// Prefix of the variables of all settings.
pub(super) const PREFIX: &str = "PINSTACK_";

/// Variables that are not settings of the server: of other commands, tests, fuzzers and benches.
const ELSEWHERE: [&str; 7] = ["CONFIG", "TOKEN", "URL", "SERVER", "SHARED", "SOAK", "SHINESTACKER"];
const ELSEWHERE_PREFIXES: [&str; 2] = ["TEST_", "FUZZ_"];

/// Largest edit distance at which an error message suggests a setting.
const NEAR: usize = 3;

/// Refuses environment variables that are not settings. `settings` are the keys as in the file.
///
/// # Errors
/// With the name of the variable, and the most similar setting.
pub(super) fn check(names: impl Iterator<Item = String>, settings: &[&str]) -> anyhow::Result<()> {
    for name in names {
        let Some(key) = name.strip_prefix(PREFIX) else { continue };
        if is_known(key, settings) {
            continue;
        }
        let key = key.to_ascii_lowercase();
        let nearest = settings.iter().min_by_key(|setting| strsim::damerau_levenshtein(setting, &key));
        match nearest {
            Some(nearest) if strsim::damerau_levenshtein(nearest, &key) <= NEAR => {
                bail!("{name} is not a setting; did you mean {PREFIX}{}?", nearest.to_uppercase())
            }
            _ => bail!("{name} is not a setting; unset it ('pinstack serve --help' lists the settings)"),
        }
    }
    Ok(())
}

fn is_known(key: &str, settings: &[&str]) -> bool {
    settings.iter().any(|setting| key == setting.to_uppercase())
        || ELSEWHERE.contains(&key)
        || ELSEWHERE_PREFIXES.iter().any(|prefix| key.starts_with(prefix))
        || is_of_a_service(key)
}

/// True for the variables that Kubernetes sets in every container for a service called `pinstack` (or `pinstack-...`):
/// `PINSTACK_SERVICE_HOST`, `PINSTACK_PORT`, `PINSTACK_PORT_8080_TCP_ADDR`, `PINSTACK_WEB_SERVICE_HOST`, ...
fn is_of_a_service(key: &str) -> bool {
    let ends = ["SERVICE_HOST", "SERVICE_PORT", "PORT"];
    ends.iter().any(|end| key == *end || key.ends_with(&format!("_{end}")))
        || key.starts_with("SERVICE_PORT_")
        || key.contains("_SERVICE_PORT_")
        || key.split("PORT_").nth(1).is_some_and(|rest| rest.starts_with(|c: char| c.is_ascii_digit()))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SETTINGS: [&str; 4] = ["auth", "isolate_tokens", "port_file", "workers"];

    fn told(name: &str) -> Option<String> {
        check([name.to_owned()].into_iter(), &SETTINGS).err().map(|error| error.to_string())
    }

    #[test]
    fn a_misspelt_variable_is_refused_with_a_suggestion() {
        for (name, meant) in [
            ("PINSTACK_AUTHH", "did you mean PINSTACK_AUTH?"),
            ("PINSTACK_ISOLATE_TOKEN", "did you mean PINSTACK_ISOLATE_TOKENS?"),
            ("PINSTACK_wokrers", "did you mean PINSTACK_WORKERS?"),
            ("PINSTACK_COLOUR_OF_THE_LAMP", "unset it"),
        ] {
            let told = told(name).unwrap_or_default();
            assert!(told.contains(name) && told.contains(meant), "{told}");
        }
    }

    #[test]
    fn settings_and_foreign_variables_are_accepted() {
        for name in [
            "PATH",
            "PINSTACK_AUTH",
            "PINSTACK_PORT_FILE",
            "PINSTACK_CONFIG",
            "PINSTACK_SERVICE_HOST",
            "PINSTACK_SERVICE_PORT_HTTP",
            "PINSTACK_PORT",
            "PINSTACK_PORT_8080_TCP_ADDR",
            "PINSTACK_WEB_PORT_80_TCP",
        ] {
            assert_eq!(told(name), None);
        }
    }
}
