//! What a viewer is sent.

use data_encoding::BASE64;
use serde_json::{Value, json};

use super::{CHANNELS, ViewerService};

/// What the server is and can; the first message to a viewer.
pub(crate) fn server_info(session: &str) -> String {
    json!({
        "op": "serverInfo",
        "name": format!("foretrace {}", env!("CARGO_PKG_VERSION")),
        "capabilities": ["time", "parameters", "parametersSubscribe", "services"],
        "supportedEncodings": ["json"],
        "metadata": { "frame": "paper" },
        "sessionId": session,
    })
    .to_string()
}

/// The topics, with the schemas of the recording.
pub(crate) fn advertise() -> String {
    let channels: Vec<Value> = (1_u64..)
        .zip(CHANNELS)
        .map(|(id, topic)| {
            let (name, encoding, schema) = topic.schema();
            json!({
                "id": id,
                "topic": topic.name(),
                "encoding": topic.encoding(),
                "schemaName": name,
                "schemaEncoding": encoding,
                "schema": BASE64.encode(&schema),
            })
        })
        .collect();
    json!({ "op": "advertise", "channels": channels }).to_string()
}

pub(crate) fn advertise_services() -> String {
    let schema = |name: &str, properties: Value| {
        let schema = json!({ "type": "object", "properties": properties }).to_string();
        json!({ "encoding": "json", "schemaName": name, "schemaEncoding": "jsonschema", "schema": schema })
    };
    let services: Vec<Value> = ViewerService::ALL
        .into_iter()
        .map(|service| {
            let asked = match service {
                ViewerService::Stop => schema("foretrace.Stop", json!({})),
                ViewerService::Arm => schema("foretrace.Arm", json!({ "token": { "type": "string" } })),
            };
            json!({
                "id": service.id(),
                "name": service.name(),
                "type": service.name(),
                "request": asked,
                "response": schema("foretrace.Answer", json!({ "words": { "type": "string" } })),
            })
        })
        .collect();
    json!({ "op": "advertiseServices", "services": services }).to_string()
}

/// How grave a status is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum StatusLevel {
    Warning = 1,
    Error = 2,
}

pub(crate) fn status(level: StatusLevel, words: &str, id: Option<&str>) -> String {
    with_id(json!({ "op": "status", "level": level as u8, "message": words }), id)
}

/// The text of `message`, with an id where there is one.
fn with_id(mut message: Value, id: Option<&str>) -> String {
    if let (Some(id), Some(fields)) = (id, message.as_object_mut()) {
        fields.insert("id".to_owned(), id.into());
    }
    message.to_string()
}

pub(crate) fn remove_status(id: &str) -> String {
    json!({ "op": "removeStatus", "statusIds": [id] }).to_string()
}

/// Values of parameters, for whoever asked under `id` or subscribed to them.
pub(crate) fn parameter_values(values: &[(&str, Value)], id: Option<&str>) -> String {
    let parameters: Vec<Value> = values
        .iter()
        .map(|(name, value)| match value {
            Value::Number(_) => json!({ "name": name, "type": "float64", "value": value }),
            _ => json!({ "name": name, "value": value }),
        })
        .collect();
    with_id(json!({ "op": "parameterValues", "parameters": parameters }), id)
}

pub(crate) fn call_failed(service: u32, call: u32, words: &str) -> String {
    json!({ "op": "serviceCallFailure", "serviceId": service, "callId": call, "message": words }).to_string()
}

pub(crate) fn call_done(service: u32, call: u32, words: &str) -> Vec<u8> {
    let numbers = [service, call, 4].map(u32::to_le_bytes);
    [&[3][..], numbers.as_flattened(), b"json", json!({ "words": words }).to_string().as_bytes()].concat()
}

pub(crate) fn message_data(subscription: u32, time_ns: u64, data: &[u8]) -> Vec<u8> {
    [&[1][..], &subscription.to_le_bytes(), &time_ns.to_le_bytes(), data].concat()
}

pub(crate) fn time(time_ns: u64) -> Vec<u8> {
    [&[2][..], &time_ns.to_le_bytes()].concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_viewers_are_reported_has_the_form_of_the_protocol() {
        let advertised: Value = serde_json::from_str(&advertise()).unwrap();
        for (channel, topic) in advertised["channels"].as_array().unwrap().iter().zip(CHANNELS) {
            assert_eq!(channel["topic"], topic.name());
            let schema = BASE64.decode(channel["schema"].as_str().unwrap().as_bytes()).unwrap();
            assert_eq!(
                (channel["schemaName"].as_str().unwrap(), schema),
                (&*topic.schema().0, topic.schema().2)
            );
        }
        assert_eq!(message_data(7, 258, &[9]), [1, 7, 0, 0, 0, 2, 1, 0, 0, 0, 0, 0, 0, 9]);
        assert_eq!(time(1), [2, 1, 0, 0, 0, 0, 0, 0, 0]);
        let done = call_done(1, 2, "x");
        assert_eq!(
            (&done[..9], &done[9..13], &done[13..17]),
            (&[3, 1, 0, 0, 0, 2, 0, 0, 0][..], &[4, 0, 0, 0][..], &b"json"[..])
        );
        let values = parameter_values(&[("trust", json!(0.5)), ("mode", json!("idle"))], Some("a"));
        let values: Value = serde_json::from_str(&values).unwrap();
        assert_eq!(values["parameters"][0]["type"], "float64");
        assert_eq!(
            (&values["id"], &values["parameters"][1]),
            (&json!("a"), &json!({"name":"mode","value":"idle"}))
        );
    }
}
