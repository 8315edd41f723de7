//! Query parameters as typed values: deserialises the text of a URL into any struct, with errors that name the
//! parameter.

use std::borrow::Cow;

use axum::http::Uri;
use jiff::{Timestamp, civil::Date, tz::TimeZone};
use percent_encoding::percent_decode_str;
use serde::{
    Deserialize, Deserializer,
    de::{
        self, DeserializeOwned, IntoDeserializer,
        value::{MapDeserializer, SeqDeserializer},
    },
    forward_to_deserialize_any,
};

use crate::{
    contract::{Code, Fault, JobKind, JobState, Name, Verdict},
    http::problem::ApiError,
    store::JobFilter,
};
use pinstack_science::types::error::ErrorLocation;

/// Largest number of query parameters; the largest operation, the archive of a scan, has 38.
const MAX_PARAMETERS: usize = 64;

/// The parameters of a URL in their order. A repeated parameter is an error.
///
/// # Errors
/// `invalid_request` for text that is not UTF-8, more than 64 parameters, or a parameter given twice.
pub fn pairs(uri: &Uri) -> Result<Vec<(String, String)>, ApiError> {
    let count = uri.query().map_or(0, |query| query.split('&').take(MAX_PARAMETERS + 1).count());
    if count > MAX_PARAMETERS {
        let detail = format!("the URL has more than {MAX_PARAMETERS} query parameters; omit those that are not needed");
        return Err(ApiError::new(Code::InvalidRequest, detail));
    }
    let written = uri.query().unwrap_or_default().split('&').filter(|pair| !pair.is_empty());
    let pairs: Vec<_> = written.map(decoded).collect::<Result<_, _>>()?;
    for (i, (name, _)) in pairs.iter().enumerate() {
        if pairs.iter().take(i).any(|(earlier, _)| earlier == name) {
            let name: String = name.chars().take(80).collect();
            let detail = format!("the parameter '{name}' is given twice; give it once");
            return Err(ApiError::new(Code::InvalidRequest, detail));
        }
    }
    Ok(pairs)
}

/// The name and the value of a parameter, which the URL has as percent-encoded UTF-8 with `+` for a blank.
fn decoded(pair: &str) -> Result<(String, String), ApiError> {
    let (name, value) = pair.split_once('=').unwrap_or((pair, ""));
    let text = |part: &str| percent_decode_str(&part.replace('+', " ")).decode_utf8().map(Cow::into_owned);
    let (Ok(name), Ok(value)) = (text(name), text(value)) else {
        let name: String = name.chars().take(80).collect();
        let detail = format!(
            "the parameter '{name}' is not UTF-8; write names and values of parameters as percent-encoded UTF-8"
        );
        let place = ErrorLocation { detail: detail.clone(), pointer: Some(name), ..ErrorLocation::default() };
        return Err(Fault::new(Code::InvalidRequest, detail).at(place).into());
    };
    Ok((name, value))
}

/// Removes a parameter from the list and returns it.
pub fn take(pairs: &mut Vec<(String, String)>, name: &str) -> Option<String> {
    let at = pairs.iter().position(|(n, _)| n == name)?;
    Some(pairs.remove(at).1)
}

/// Deserialises the parameters into a struct.
///
/// # Errors
/// `invalid_request` with the parameter, its value, and what it must be.
pub fn typed<T: DeserializeOwned>(pairs: &[(String, String)]) -> Result<T, ApiError> {
    let map = pairs.iter().map(|(name, text)| (name.as_str(), Parameter { name, text }));
    T::deserialize(MapDeserializer::new(map)).map_err(|Refusal { name, detail }| {
        let place = ErrorLocation { detail: detail.clone(), pointer: name, ..ErrorLocation::default() };
        Fault::new(Code::InvalidRequest, detail).at(place).into()
    })
}

/// The parameters of a URL as a struct.
///
/// # Errors
/// As [`pairs`] and [`typed`].
pub fn from_uri<T: DeserializeOwned>(uri: &Uri) -> Result<T, ApiError> {
    typed(&pairs(uri)?)
}

/// Refuses remaining parameters.
///
/// # Errors
/// `invalid_request` with the first of them and the known parameters.
pub fn refuse_rest(pairs: &[(String, String)], known: &str) -> Result<(), ApiError> {
    let Some((name, _)) = pairs.first() else { return Ok(()) };
    let name: String = name.chars().take(80).collect();
    Err(ApiError::new(Code::InvalidRequest, format!("unknown parameter '{name}'; known parameters: {known}")))
}

/// The filter of a list of jobs.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct JobParameters {
    state: Option<JobState>,
    rig: Option<Name>,
    lens: Option<Name>,
    scan: Option<Name>,
    verdict: Option<Verdict>,
    q: Option<String>,
    since: Option<String>,
    until: Option<String>,
}

/// The filter of a list of jobs: `state`, `rig`, `lens`, `scan`, `verdict`, `q`, `since` and `until`.
///
/// # Errors
/// `invalid_request` that names the parameter.
pub fn job_filter(kind: JobKind, pairs: &[(String, String)]) -> Result<JobFilter, ApiError> {
    let JobParameters { state, rig, lens, scan, verdict, q, since, until } = typed(pairs)?;
    let since = since.map(|text| moment("since", &text, Edge::Begin)).transpose()?;
    let until = until.map(|text| moment("until", &text, Edge::End)).transpose()?;
    Ok(JobFilter { kind: Some(kind), state, rig, lens, scan, verdict, q, since, until, ..JobFilter::default() })
}

/// Which end of a day a date stands for.
#[derive(Clone, Copy)]
enum Edge {
    Begin,
    End,
}

/// A date (UTC), or a time with its offset.
fn moment(name: &str, text: &str, edge: Edge) -> Result<Timestamp, ApiError> {
    let text = text.trim();
    let day = || {
        let date: Date = text.parse().ok()?;
        let date = if let Edge::End = edge { date.tomorrow().ok()? } else { date };
        Some(date.to_zoned(TimeZone::UTC).ok()?.timestamp())
    };
    text.parse().ok().or_else(day).ok_or_else(|| {
        let text: String = text.chars().take(80).collect();
        let detail =
            format!("{name} is '{text}'; it must be a date such as 2026-11-27, or a time such as 2026-11-27T08:00:00Z");
        let place =
            ErrorLocation { detail: detail.clone(), pointer: Some(name.to_owned()), ..ErrorLocation::default() };
        Fault::new(Code::InvalidRequest, detail).at(place).into()
    })
}

/// The error of a parameter.
#[derive(Debug)]
struct Refusal {
    name: Option<String>,
    detail: String,
}

impl std::fmt::Display for Refusal {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.detail)
    }
}

impl std::error::Error for Refusal {}

impl de::Error for Refusal {
    fn custom<T: std::fmt::Display>(message: T) -> Self {
        Self { name: None, detail: message.to_string() }
    }

    fn missing_field(field: &'static str) -> Self {
        Self { name: Some(field.to_owned()), detail: format!("the parameter '{field}' is missing; add it to the URL") }
    }

    fn unknown_field(field: &str, expected: &'static [&'static str]) -> Self {
        let field: String = field.chars().take(80).collect();
        let detail = format!("unknown parameter '{field}'; known parameters: {}", expected.join(", "));
        Self { name: Some(field), detail }
    }
}

/// The name and the text of one parameter.
#[derive(Clone, Copy)]
struct Parameter<'a> {
    name: &'a str,
    text: &'a str,
}

impl Parameter<'_> {
    fn refuse(self, must: &str) -> Refusal {
        let text: String = self.text.chars().take(80).collect();
        Refusal { name: Some(self.name.to_owned()), detail: format!("{} is '{text}'; it must be {must}", self.name) }
    }

    /// Adds the name of the parameter to an error of its type.
    fn named(self, refusal: Refusal) -> Refusal {
        let detail = match &refusal.name {
            None if !refusal.detail.contains(self.name) => format!("{}: {}", self.name, refusal.detail),
            _ => refusal.detail,
        };
        Refusal { name: Some(self.name.to_owned()), detail }
    }
}

impl<'de> IntoDeserializer<'de, Refusal> for Parameter<'de> {
    type Deserializer = Self;
    fn into_deserializer(self) -> Self {
        self
    }
}

macro_rules! parsed {
    ($($method:ident $visit:ident $must:literal;)*) => {$(
        fn $method<V: de::Visitor<'de>>(self, visitor: V) -> Result<V::Value, Refusal> {
            let value = self.text.trim().parse().map_err(|_| self.refuse($must))?;
            visitor.$visit(value).map_err(|e| self.named(e))
        }
    )*};
}

impl<'de> Deserializer<'de> for Parameter<'de> {
    type Error = Refusal;

    parsed! {
        deserialize_bool visit_bool "true or false";
        deserialize_u8 visit_u8 "a whole number";
        deserialize_u16 visit_u16 "a whole number";
        deserialize_u32 visit_u32 "a whole number";
        deserialize_u64 visit_u64 "a whole number";
        deserialize_i64 visit_i64 "a whole number";
        deserialize_f64 visit_f64 "a number";
    }

    fn deserialize_any<V: de::Visitor<'de>>(self, visitor: V) -> Result<V::Value, Refusal> {
        visitor.visit_str(self.text).map_err(|e| self.named(e))
    }

    fn deserialize_option<V: de::Visitor<'de>>(self, visitor: V) -> Result<V::Value, Refusal> {
        visitor.visit_some(self)
    }

    fn deserialize_newtype_struct<V: de::Visitor<'de>>(self, _: &'static str, visitor: V) -> Result<V::Value, Refusal> {
        visitor.visit_newtype_struct(self)
    }

    /// A list is written with commas, in square brackets or without.
    fn deserialize_seq<V: de::Visitor<'de>>(self, visitor: V) -> Result<V::Value, Refusal> {
        let list = self.text.trim();
        let list = list.strip_prefix('[').and_then(|list| list.strip_suffix(']')).unwrap_or(list);
        let items = list.split(',').filter(|_| !list.trim().is_empty());
        let items = items.map(|text| Parameter { text: text.trim(), ..self });
        visitor.visit_seq(SeqDeserializer::new(items)).map_err(|e| self.named(e))
    }

    fn deserialize_enum<V: de::Visitor<'de>>(
        self,
        _: &'static str,
        variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Refusal> {
        if !variants.contains(&self.text) {
            return Err(self.refuse(&format!("one of: {}", variants.join(", "))));
        }
        visitor.visit_enum(de::value::StrDeserializer::new(self.text))
    }

    forward_to_deserialize_any! {
        i8 i16 i32 f32 char str string bytes byte_buf unit unit_struct tuple tuple_struct map struct
        identifier ignored_any
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contract::options::{BitDepth, Crop, MaskMode, StackOptions};
    use pinstack_science::types::{calibration_options::CalibrationOptions, mask_options::MaskThreshold};

    fn options(query: &str) -> Result<StackOptions, String> {
        let uri: Uri = format!("/x?{query}").parse().expect("a test writes valid URLs");
        from_uri(&uri).map_err(|e| e.fault().detail.clone())
    }

    #[test]
    fn every_kind_of_option_is_read_from_text() {
        let read = options("mask=required&mask_threshold=0.4&bit_depth=16&crop=1,2,30,40&r1=20&eps2=1e-5&label=a%20b")
            .expect("all of them are valid");
        assert_eq!(read.mask, MaskMode::Required);
        assert_eq!(read.mask_threshold, MaskThreshold::Fixed(0.4));
        assert_eq!(read.bit_depth, BitDepth::Sixteen);
        assert_eq!(read.crop, Crop::Rect { x: 1, y: 2, width: 30, height: 40 });
        assert_eq!((read.r1, read.eps2), (20, 1e-5));
        assert_eq!(read.label.as_deref(), Some("a b"));
    }

    #[test]
    fn a_list_is_written_with_commas() {
        let read = |text: &str| -> Result<CalibrationOptions, String> {
            let uri: Uri = format!("/x?rail_positions_mm={text}").parse().expect("a test writes valid URLs");
            from_uri(&uri).map_err(|e| e.fault().detail.clone())
        };
        for text in ["0,0.5,-1", "[0,0.5,%20-1]"] {
            assert_eq!(read(text).expect(text).rail_positions_mm, Some(vec![0.0, 0.5, -1.0]));
        }
        assert_eq!(read("").expect("no positions").rail_positions_mm, Some(vec![]));
        assert_eq!(read("0,x,1").unwrap_err(), "rail_positions_mm is 'x'; it must be a number");
        assert_eq!(read("0,,1").unwrap_err(), "rail_positions_mm is ''; it must be a number");
    }

    #[test]
    fn a_date_is_a_whole_day() {
        let bounds = |query: &str| {
            let uri: Uri = format!("/x?{query}").parse().expect("a test writes valid URLs");
            let filter = job_filter(JobKind::Stack, &pairs(&uri).expect("pairs"));
            filter.map(|it| (it.since, it.until)).map_err(|e| e.fault().detail.clone())
        };
        let at = |text: &str| Some(text.parse::<Timestamp>().expect("a time"));
        let day = bounds("since=2026-11-27&until=2026-11-27").expect("a day");
        assert_eq!(day, (at("2026-11-27T00:00:00Z"), at("2026-11-28T00:00:00Z")));
        assert_eq!(bounds("since=2026-11-27T08:00:00%2B01:00").expect("a time").0, at("2026-11-27T07:00:00Z"));
        assert!(bounds("until=yesterday").unwrap_err().starts_with("until is 'yesterday'; it must be a date such as"));
    }

    #[test]
    fn a_refusal_names_the_parameter_and_what_it_must_be() {
        assert_eq!(options("r1=many").unwrap_err(), "r1 is 'many'; it must be a whole number");
        assert_eq!(options("mask=maybe").unwrap_err(), "mask is 'maybe'; it must be one of: auto, none, required");
        assert!(options("bit_depth=12").unwrap_err().contains("'auto', '8' or '16'"));
        assert!(options("r7=1").unwrap_err().starts_with("unknown parameter 'r7'; known parameters: profile_revision"));
        assert!(options("r1=1&r1=2").unwrap_err().contains("given twice"));
        assert!(options("scan=.hidden").unwrap_err().contains("not beginning with a dot"));
    }
}
