//! The macro that turns the rows of settings into structs, flags, checks and texts.

/// Generates `Settings`, `Flags`, `Policy` and `ROWS`.
///
/// - `values` have a default, `optional` settings may be unset (the text says what happens then), `lists` are flags
///   that may be given several times.
/// - `in`, `at_least` and `check` are the rule of a setting.
/// - `policy name: type` puts a setting into `Policy`; `= f` converts its value.
/// - `beside` has the members of `Policy` that are no settings.
macro_rules! settings {
    (
        values { $(
            $key:ident: $type:ty = $default:expr, $value_name:literal, $help:literal
                $(, in $least:literal ..= $most:literal)?
                $(, at_least $low:literal)?
                $(, check $holds:expr => $rule:literal)?
                $(, clap($($clap:tt)*))?
                $(, policy $p_key:ident: $p_type:ty $(= $p_of:expr)?)?;
        )* }
        optional { $(
            $o_key:ident: $o_type:ty, $unset:literal, $o_value_name:literal, $o_help:literal
                $(, check $o_holds:expr => $o_rule:literal)?
                $(, policy $op_key:ident: $op_type:ty)?;
        )* }
        lists { $(
            $l_key:ident = $l_default:expr, $l_flag:literal, $l_value_name:literal, $l_help:literal,
                check $l_holds:expr => $l_rule:literal
                $(, policy $lp_key:ident: $lp_type:ty $(= $lp_of:expr)?)?;
        )* }
        beside { $(
            $b_key:ident: $b_type:ty = $b_default:expr, $b_doc:literal;
        )* }
    ) => {
        /// The settings of a server.
        // the help texts are for terminals, which show addresses as they are
        #[allow(rustdoc::bare_urls)]
        #[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
        #[serde(deny_unknown_fields)]
        pub struct Settings {
            $(#[doc = $help] pub $key: $type,)*
            $(#[doc = $o_help] pub $o_key: Option<$o_type>,)*
            $(#[doc = $l_help] pub $l_key: Vec<String>,)*
        }

        impl Default for Settings {
            fn default() -> Self {
                Self { $($key: $default,)* $($o_key: None,)* $($l_key: $l_default,)* }
            }
        }

        /// Limits and rules of the service, which requests depend on.
        #[allow(rustdoc::bare_urls)]
        #[derive(Debug, Clone)]
        pub struct Policy {
            $($(#[doc = $help] pub $p_key: $p_type,)?)*
            $($(#[doc = $o_help] pub $op_key: Option<$op_type>,)?)*
            $($(#[doc = $l_help] pub $lp_key: $lp_type,)?)*
            $(#[doc = $b_doc] pub $b_key: $b_type,)*
        }

        impl From<Settings> for Policy {
            fn from(settings: Settings) -> Self {
                Self {
                    $($($p_key: converted!(settings.$key $(, $p_of)?),)?)*
                    $($($op_key: settings.$o_key,)?)*
                    $($($lp_key: converted!(settings.$l_key $(, $lp_of)?),)?)*
                    $($b_key: $b_default,)*
                }
            }
        }

        /// The settings as flags. One that is not given is taken from the environment, the file or the defaults.
        #[derive(Debug, Clone, Default, clap::Args, Serialize)]
        pub struct Flags {
            /// TOML file with any of the settings below, in snake_case [env: PINSTACK_CONFIG]
            #[arg(long, value_name = "FILE")]
            #[serde(skip)]
            pub config: Option<PathBuf>,
            $(
                #[arg(long, value_name = $value_name, help = help(stringify!($key)) $(, $($clap)*)?)]
                #[serde(skip_serializing_if = "Option::is_none")]
                pub(crate) $key: Option<$type>,
            )*
            $(
                #[arg(long, value_name = $o_value_name, help = help(stringify!($o_key)))]
                #[serde(skip_serializing_if = "Option::is_none")]
                pub(crate) $o_key: Option<$o_type>,
            )*
            $(
                #[arg(long = $l_flag, value_name = $l_value_name, help = help(stringify!($l_key)))]
                #[serde(skip_serializing_if = "Vec::is_empty")]
                pub(crate) $l_key: Vec<String>,
            )*
        }

        /// The texts of all settings.
        pub(super) const ROWS: &[Row] = &[
            $(Row { key: stringify!($key), flag: None, text: $help, unset: "" },)*
            $(Row { key: stringify!($o_key), flag: None, text: $o_help, unset: $unset },)*
            $(Row { key: stringify!($l_key), flag: Some($l_flag), text: $l_help, unset: "" },)*
        ];

        impl Settings {
            /// Key and rule of the first setting that breaks its rule.
            pub(super) fn violation(&self) -> Option<(&'static str, String)> {
                // gives the closures of the table their types
                let rule = |key, holds: fn(&Self) -> bool, rule: &str| (key, holds(self), rule.to_owned());
                let rules: Vec<(&'static str, bool, String)> = vec![
                    $($((
                        stringify!($key),
                        ($least..=$most).contains(&self.$key),
                        format!("must be {} to {}", $least, $most),
                    ),)?)*
                    $($((stringify!($key), self.$key >= $low, format!("must be at least {}", $low)),)?)*
                    $($(rule(stringify!($key), $holds, $rule),)?)*
                    $($(rule(stringify!($o_key), $o_holds, $o_rule),)?)*
                    $(rule(stringify!($l_key), $l_holds, $l_rule),)*
                ];
                rules.into_iter().find(|(_, holds, _)| !holds).map(|(key, _, rule)| (key, rule))
            }
        }
    };
}

/// A value, or what a function makes of it.
macro_rules! converted {
    ($value:expr) => {
        $value
    };
    ($value:expr, $of:expr) => {
        $of($value)
    };
}

pub(super) use {converted, settings};
