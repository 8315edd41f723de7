//! The options of the API as flags: names and help are those of its schema, so they exist once.
//!
//! In: a type of options. Out: a flag per option, `mask_threshold` as `--mask-threshold`, whose text is read as the
//! query parameter is.

use std::fmt::Debug;

use clap::{Arg, ArgMatches, Args, Command, Error, FromArgMatches, error::ErrorKind};
use serde::de::DeserializeOwned;
use serde_json::Value;
use utoipa::{
    ToSchema,
    openapi::{RefOr, Schema},
};

use crate::{contract::options::StackOptions, http::extract::params};
use pinstack_science::types::calibration_options::CalibrationOptions;

/// Options of the API that commands offer.
pub(super) trait Offered: ToSchema + DeserializeOwned {
    /// Their heading in the help.
    const HEADING: &'static str;
    /// Those that have no meaning without a server.
    const LEFT_OUT: &'static [&'static str];
}

impl Offered for StackOptions {
    const HEADING: &'static str = "Options of a stack";
    const LEFT_OUT: &'static [&'static str] = &["label", "scan", "pan_deg", "tilt_deg", "keep_days", "priority"];
}

impl Offered for CalibrationOptions {
    const HEADING: &'static str = "Options of a calibration";
    const LEFT_OUT: &'static [&'static str] =
        &["source", "from", "moved_target", "moved_target_pitch_px", "allow_new_size", "keep"];
}

/// Options from flags.
#[derive(Debug)]
pub(super) struct OptionFlags<O>(pub O);

/// Name and help of each option.
fn offered<O: Offered>() -> Vec<(String, String)> {
    let json = |schema: &RefOr<Schema>| serde_json::to_value(schema).unwrap_or_default();
    let mut named = Vec::new();
    O::schemas(&mut named);
    let help = |of: &Value| {
        // an optional enumeration is a choice between a reference and null
        let choices = of["oneOf"].as_array().into_iter().flatten();
        let of = choices.into_iter().find(|choice| choice.get("$ref").is_some()).unwrap_or(of);
        let described = of["description"].as_str().unwrap_or_default();
        let kind = of["$ref"].as_str().and_then(|kind| kind.rsplit('/').next()).unwrap_or_default();
        let schema = named.iter().find(|(name, _)| name == kind).map(|(_, schema)| json(schema)).unwrap_or_default();
        let values = schema["enum"].as_array().into_iter().flatten().filter_map(Value::as_str);
        // most descriptions have them
        let values: Vec<&str> = values.filter(|value| !described.contains(&format!("`{value}`"))).collect();
        let values = if values.is_empty() { String::new() } else { format!(" [{}]", values.join(", ")) };
        described.replace('\n', " ").replace('`', "") + &values
    };
    let schema = json(&O::schema());
    let properties = schema["properties"].as_object().into_iter().flatten();
    let offered = properties.filter(|(name, _)| !O::LEFT_OUT.contains(&name.as_str()));
    offered.map(|(name, of)| (name.clone(), help(of))).collect()
}

impl<O: Offered> Args for OptionFlags<O> {
    fn augment_args(command: Command) -> Command {
        // once per process
        let kept = |text: String| -> &'static str { text.leak() };
        offered::<O>().into_iter().fold(command, |command, (name, help)| {
            let (flag, name) = (kept(name.replace('_', "-")), kept(name));
            let arg = Arg::new(name).long(flag).value_name("VALUE").help(help).help_heading(O::HEADING);
            let arg = if flag == name { arg } else { arg.alias(name) };
            command.arg(arg.allow_hyphen_values(true))
        })
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl<O: Offered> FromArgMatches for OptionFlags<O> {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, Error> {
        let given = |(name, _): (String, String)| Some((matches.get_one::<String>(&name)?.clone(), name));
        let pairs: Vec<_> = offered::<O>().into_iter().filter_map(given).map(|(text, name)| (name, text)).collect();
        let refused = |detail: &str| Error::raw(ErrorKind::ValueValidation, format!("{detail}\n"));
        params::typed(&pairs).map(Self).map_err(|error| refused(&error.fault().detail))
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contract::options::{Crop, MaskMode};
    use clap::Parser;

    #[derive(Debug, Parser)]
    struct Both {
        #[command(flatten)]
        stack: OptionFlags<StackOptions>,
        #[command(flatten)]
        calibration: OptionFlags<CalibrationOptions>,
    }

    #[test]
    fn every_option_has_a_flag_with_help_except_those_of_the_server() {
        for (name, help) in offered::<StackOptions>().into_iter().chain(offered::<CalibrationOptions>()) {
            assert!(help.len() > 10 && !help.contains('`'), "{name}: {help}");
        }
        let format = offered::<StackOptions>().into_iter().find(|(name, _)| name == "format").expect("an option").1;
        assert_eq!(format, "File format of the image. [png, tiff, jpeg]");
        let names = offered::<StackOptions>().into_iter().map(|(name, _)| name).collect::<Vec<_>>();
        assert!(names.len() > 20 && names.contains(&"mask_threshold".to_owned()), "{names:?}");
        for left_out in StackOptions::LEFT_OUT {
            assert!(!names.contains(&(*left_out).to_owned()));
        }
    }

    #[test]
    fn flags_are_read_as_parameters_are() {
        let read = Both::try_parse_from([
            "x",
            "--mask",
            "none",
            "--crop",
            "1,2,30,40",
            "--rail-step-mm",
            "-0.5",
            "--r_g",
            "3",
        ]);
        let Both { stack, calibration } = read.expect("valid");
        assert_eq!((stack.0.mask, stack.0.r_g), (MaskMode::None, 3));
        assert_eq!(stack.0.crop, Crop::Rect { x: 1, y: 2, width: 30, height: 40 });
        assert_eq!(calibration.0.rail_step_mm, Some(-0.5));
        let refused = Both::try_parse_from(["x", "--mask", "maybe"]).expect_err("not an option").to_string();
        assert!(refused.contains("mask is 'maybe'; it must be one of: auto, none, required"), "{refused}");
    }
}
