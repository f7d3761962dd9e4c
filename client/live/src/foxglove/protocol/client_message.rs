//! What a viewer may say.
//!
//! Contract: pure and total: any text or bytes give a message or a word for the count of refusals. Lists and
//! names have bounds. Fields that the protocol may gain later are ignored.

use serde::Deserialize;
use serde_json::Value;

use super::MESSAGE_BYTES;

/// Most entries of a list in a message.
const ENTRIES: usize = 64;

/// What a viewer wants to be set.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum ViewerSetting {
    Trust(f64),
    TrustAuto,
    Predictor(String),
}

/// What a viewer says.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum ViewerMessage {
    /// Number of each subscription, and its channel.
    Subscribe(Vec<(u32, u64)>),
    Unsubscribe(Vec<u32>),
    /// Names, all of them where there are none; an id for the answer.
    GetParameters(Vec<String>, Option<String>),
    SetParameters(Vec<(String, ViewerSetting)>, Option<String>),
    SubscribeParameters(Vec<String>),
    UnsubscribeParameters(Vec<String>),
    /// Call, with the token that its payload may carry.
    Call {
        service: u32,
        call: u32,
        token: Option<String>,
    },
}

#[derive(Deserialize)]
#[serde(tag = "op", rename_all = "camelCase")]
enum Text {
    #[serde(rename_all = "camelCase")]
    Subscribe { subscriptions: Vec<Subscription> },
    #[serde(rename_all = "camelCase")]
    Unsubscribe { subscription_ids: Vec<u32> },
    #[serde(rename_all = "camelCase")]
    GetParameters { parameter_names: Vec<String>, id: Option<String> },
    #[serde(rename_all = "camelCase")]
    SetParameters { parameters: Vec<Parameter>, id: Option<String> },
    #[serde(rename_all = "camelCase")]
    SubscribeParameterUpdates { parameter_names: Vec<String> },
    #[serde(rename_all = "camelCase")]
    UnsubscribeParameterUpdates { parameter_names: Vec<String> },
    #[serde(other)]
    Other,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Subscription {
    id: u32,
    channel_id: u64,
}

#[derive(Deserialize)]
struct Parameter {
    name: String,
    #[serde(default)]
    value: Value,
}

/// Reads a text of a viewer.
pub(crate) fn text(text: &str) -> Result<ViewerMessage, &'static str> {
    if text.len() > MESSAGE_BYTES {
        return Err("message too long");
    }
    let text: Text = serde_json::from_str(text).map_err(|_| "message not understood")?;
    fn bounded<T>(list: Vec<T>) -> Result<Vec<T>, &'static str> {
        if list.len() > ENTRIES { Err("list too long") } else { Ok(list) }
    }
    let short = |id: Option<String>| match id {
        Some(id) if id.len() > 256 => Err("id too long"),
        id => Ok(id),
    };
    Ok(match text {
        Text::Subscribe { subscriptions } => {
            let wanted = bounded(subscriptions)?.into_iter().map(|one| (one.id, one.channel_id));
            ViewerMessage::Subscribe(wanted.collect())
        }
        Text::Unsubscribe { subscription_ids } => ViewerMessage::Unsubscribe(bounded(subscription_ids)?),
        Text::GetParameters { parameter_names, id } => {
            ViewerMessage::GetParameters(bounded(parameter_names)?, short(id)?)
        }
        Text::SetParameters { parameters, id } => {
            let (parameters, id) = (bounded(parameters)?, short(id)?);
            ViewerMessage::SetParameters(parameters.into_iter().map(setting).collect::<Result<_, _>>()?, id)
        }
        Text::SubscribeParameterUpdates { parameter_names } => {
            ViewerMessage::SubscribeParameters(bounded(parameter_names)?)
        }
        Text::UnsubscribeParameterUpdates { parameter_names } => {
            ViewerMessage::UnsubscribeParameters(bounded(parameter_names)?)
        }
        Text::Other => return Err("not offered here"),
    })
}

fn setting(Parameter { name, value }: Parameter) -> Result<(String, ViewerSetting), &'static str> {
    let setting = match (name.as_str(), &value) {
        ("trust", Value::String(word)) if word == "auto" => ViewerSetting::TrustAuto,
        ("trust", value) => match value.as_f64() {
            Some(trust) if (0.0..=1.0).contains(&trust) => ViewerSetting::Trust(trust),
            _ => return Err("trust is a number from 0 to 1, or \"auto\""),
        },
        ("predictor", Value::String(word)) if word.len() <= 64 => ViewerSetting::Predictor(word.clone()),
        ("predictor", _) => return Err("predictor is a name"),
        _ => return Err("only trust and predictor can be set"),
    };
    Ok((name, setting))
}

/// Reads bytes of a viewer.
pub(crate) fn binary(bytes: &[u8]) -> Result<ViewerMessage, &'static str> {
    if bytes.len() > MESSAGE_BYTES {
        return Err("message too long");
    }
    match bytes.split_first() {
        Some((2, rest)) => {
            let (service, rest) = number(rest)?;
            let (call, rest) = number(rest)?;
            let (length, rest) = number(rest)?;
            let (encoding, payload) = rest.split_at_checked(length as usize).ok_or("message cut short")?;
            if !payload.is_empty() && encoding != b"json" {
                return Err("another encoding than json");
            }
            #[derive(Deserialize, Default)]
            struct Payload {
                token: Option<String>,
            }
            let payload: Payload = match payload {
                [] => Payload::default(),
                payload => serde_json::from_slice(payload).map_err(|_| "message not understood")?,
            };
            Ok(ViewerMessage::Call { service, call, token: payload.token })
        }
        Some((1 | 3, _)) => Err("not offered here"),
        _ => Err("message not understood"),
    }
}

fn number(bytes: &[u8]) -> Result<(u32, &[u8]), &'static str> {
    let (number, rest) = bytes.split_first_chunk::<4>().ok_or("message cut short")?;
    Ok((u32::from_le_bytes(*number), rest))
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXTS: [&str; 6] = [
        r#"{"op":"subscribe","subscriptions":[{"id":0,"channelId":1},{"id":7,"channelId":2}]}"#,
        r#"{"op":"unsubscribe","subscriptionIds":[0]}"#,
        r#"{"op":"getParameters","parameterNames":["trust"],"id":"a"}"#,
        r#"{"op":"setParameters","parameters":[{"name":"trust","type":"float64","value":0.5}],"id":"a"}"#,
        r#"{"op":"subscribeParameterUpdates","parameterNames":[]}"#,
        r#"{"op":"unsubscribeParameterUpdates","parameterNames":["trust"]}"#,
    ];

    fn call(encoding: &str, payload: &str) -> Vec<u8> {
        let mut bytes = vec![2, 2, 0, 0, 0, 9, 0, 0, 0];
        bytes.extend_from_slice(&(encoding.len() as u32).to_le_bytes());
        bytes.extend_from_slice(encoding.as_bytes());
        bytes.extend_from_slice(payload.as_bytes());
        bytes
    }

    #[test]
    fn every_message_of_a_viewer_is_read() {
        let trust = vec!["trust".to_owned()];
        let wanted = [
            ViewerMessage::Subscribe(vec![(0, 1), (7, 2)]),
            ViewerMessage::Unsubscribe(vec![0]),
            ViewerMessage::GetParameters(trust.clone(), Some("a".to_owned())),
            ViewerMessage::SetParameters(
                vec![("trust".to_owned(), ViewerSetting::Trust(0.5))],
                Some("a".to_owned()),
            ),
            ViewerMessage::SubscribeParameters(Vec::new()),
            ViewerMessage::UnsubscribeParameters(trust),
        ];
        for (given, wanted) in TEXTS.iter().zip(wanted) {
            assert_eq!(text(given), Ok(wanted), "{given}");
        }
        let called = |token: Option<&str>| ViewerMessage::Call {
            service: 2,
            call: 9,
            token: token.map(str::to_owned),
        };
        assert_eq!(binary(&call("json", r#"{"token":"x"}"#)), Ok(called(Some("x"))));
        assert_eq!(binary(&call("", "")), Ok(called(None)));
        assert_eq!(binary(&call("json", "{}")), Ok(called(None)));
    }

    #[test]
    fn what_is_wrong_is_refused_with_its_reason() {
        let set = |name: &str, value: &str| {
            text(&format!(r#"{{"op":"setParameters","parameters":[{{"name":"{name}","value":{value}}}]}}"#))
        };
        assert!(set("trust", "\"auto\"").is_ok() && set("predictor", "\"hold\"").is_ok());
        for (name, value) in
            [("trust", "1.5"), ("trust", "-0.1"), ("trust", "null"), ("predictor", "1"), ("mode", "1")]
        {
            assert!(set(name, value).is_err(), "{name} {value}");
        }
        let many = format!(r#"{{"op":"unsubscribe","subscriptionIds":[{}]}}"#, vec!["1"; 65].join(","));
        for (given, reason) in [
            ("", "message not understood"),
            (r#"{"op":"subscribe"}"#, "message not understood"),
            (r#"{"op":"advertise","channels":[]}"#, "not offered here"),
            (r#"{"op":"fetchAsset","uri":"file:///etc/passwd","requestId":1}"#, "not offered here"),
            (&many, "list too long"),
            (&" ".repeat(MESSAGE_BYTES + 1), "message too long"),
        ] {
            assert_eq!(text(given), Err(reason), "{given:.60}");
        }
        for (given, reason) in [
            (vec![], "message not understood"),
            (vec![9, 9], "message not understood"),
            (vec![1, 0, 0, 0, 0, 1], "not offered here"),
            (vec![2, 0, 0], "message cut short"),
            (vec![2, 1, 0, 0, 0, 1, 0, 0, 0, 255, 255, 255, 255], "message cut short"),
            (call("cdr", "{}"), "another encoding than json"),
            (call("json", "{"), "message not understood"),
        ] {
            assert_eq!(binary(&given), Err(reason), "{given:?}");
        }
    }

    #[test]
    fn any_damage_to_any_message_gives_a_message_or_a_reason() {
        let cases: u32 = std::env::var("FORETRACE_FUZZ_CASES")
            .map_or(50_000, |text| text.parse().expect("a whole number"));
        // xorshift64*: the same bytes in every run.
        let mut state = 0x0000_f0c5_910e_u64;
        let mut dice = || {
            state ^= state >> 12;
            state ^= state << 25;
            state ^= state >> 27;
            state.wrapping_mul(0x2545_f491_4f6c_dd1d)
        };
        let good: Vec<Vec<u8>> = TEXTS
            .iter()
            .map(|text| text.as_bytes().to_vec())
            .chain([call("json", r#"{"token":"x"}"#), vec![1, 0, 0, 0, 0, 1], vec![3; 20]])
            .collect();
        let mut outcomes = vec![(0, 0); good.len()];
        for case in 0..cases {
            let kind = case as usize % good.len();
            let mut bytes = good[kind].clone();
            for _ in 0..=dice() >> 62 {
                if bytes.len() < 2 {
                    break;
                }
                let at = (dice() >> 33) as usize % bytes.len();
                match dice() >> 62 {
                    0 => bytes[at] = (dice() >> 56) as u8,
                    1 => drop(bytes.remove(at)),
                    2 => bytes.insert(at, b"0123456789.-e[]{},:\""[(dice() >> 33) as usize % 20]),
                    _ => bytes.truncate(at.max(1)),
                }
            }
            let said =
                if kind < TEXTS.len() { text(&String::from_utf8_lossy(&bytes)) } else { binary(&bytes) };
            match said {
                Ok(ViewerMessage::SetParameters(settings, _)) => {
                    outcomes[kind].0 += 1;
                    for (_, setting) in settings {
                        assert!(
                            !matches!(setting, ViewerSetting::Trust(trust) if !(0.0..=1.0).contains(&trust))
                        );
                    }
                }
                Ok(_) => outcomes[kind].0 += 1,
                Err(_) => outcomes[kind].1 += 1,
            }
        }
        for (kind, (_, refused)) in outcomes.iter().enumerate() {
            assert!(*refused > 0, "kind {kind}: {outcomes:?}");
        }
        assert!(outcomes[..7].iter().all(|(read, _)| *read > 0), "{outcomes:?}");
    }
}
