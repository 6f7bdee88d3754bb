//! What can be changed while a rig runs (`POST /api/v1/control`), one thing at a time: `{"do": "pause"}`, `resume`, `step`; `{"do": "take_out", "board":
//! KEY}`, `put_back`; `{"do": "mode", "mode": "interleave"}` or `region`; `{"do": "samples", "samples": "16"}`; `{"do":
//! "debug", "picture": "depth"}`, `levels`, `skips` or `off`.

use super::{Room, problem};
use crate::backplane::live::Command;
use axum::body::Bytes;
use axum::extract::{ConnectInfo, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Json, Response};
use proto::debug::DebugPicture;
use proto::ids::BoardKey;
use proto::view::{Mode, Samples};
use serde::Deserialize;
use std::net::SocketAddr;
use std::sync::Arc;

/// What is asked.
#[derive(Clone, Debug, Deserialize)]
#[serde(tag = "do", rename_all = "snake_case", deny_unknown_fields)]
enum Asked {
    Pause,
    Resume,
    Step,
    TakeOut { board: u64 },
    PutBack { board: u64 },
    Mode { mode: ModeName },
    Samples { samples: String },
    Debug { picture: String },
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "snake_case")]
enum ModeName {
    Interleave,
    Region,
}

impl Asked {
    fn command(self) -> Result<Command, String> {
        Ok(match self {
            Self::Pause => Command::Pause,
            Self::Resume => Command::Resume,
            Self::Step => Command::Step,
            Self::TakeOut { board } => Command::TakeOut(BoardKey(board)),
            Self::PutBack { board } => Command::PutBack(BoardKey(board)),
            Self::Mode { mode: ModeName::Interleave } => Command::Mode(Mode::Interleave),
            Self::Mode { mode: ModeName::Region } => Command::Mode(Mode::Region),
            Self::Samples { samples } => {
                let found = Samples::from_name(&samples);
                Command::Samples(found.ok_or_else(|| format!("samples {samples:?}: possible are {}", Samples::NAMES))?)
            }
            Self::Debug { picture } => {
                let found = DebugPicture::from_name(&picture);
                Command::Debug(
                    found.ok_or_else(|| format!("debug picture {picture:?}: possible are {}", DebugPicture::NAMES))?,
                )
            }
        })
    }
}

/// The command in a request's body.
fn read(headers: &HeaderMap, body: &[u8]) -> Result<Command, (StatusCode, String)> {
    // A form of a foreign page can't say that; a script must ask first, and is not answered.
    let kind = headers.get(header::CONTENT_TYPE).and_then(|kind| kind.to_str().ok()).unwrap_or_default();
    if kind.split(';').next().map(str::trim) != Some("application/json") {
        return Err((StatusCode::UNSUPPORTED_MEDIA_TYPE, "send application/json".into()));
    }
    let asked: Asked = serde_json::from_slice(body)
        .map_err(|error| (StatusCode::BAD_REQUEST, format!("{error}; as in {{\"do\": \"pause\"}}")))?;
    asked.command().map_err(|error| (StatusCode::BAD_REQUEST, error))
}

/// `POST /api/v1/control`.
pub(super) async fn control(
    State(room): State<Arc<Room>>,
    ConnectInfo(from): ConnectInfo<SocketAddr>,
    headers: HeaderMap,
    body: Bytes,
) -> Response {
    if let Err(denied) = room.access.check_control(&headers) {
        return denied.into_response();
    }
    let command = match read(&headers, &body) {
        Ok(command) => command,
        Err((status, error)) => return (status, problem(&error)).into_response(),
    };
    match room.desk.command(command, format!("console, {}", from.ip())).await {
        Ok(Ok(said)) => Json(serde_json::json!({ "done": said })).into_response(),
        Ok(Err(error)) => (StatusCode::CONFLICT, problem(&error.to_string())).into_response(),
        Err(silence) => silence.into_response(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ask(body: &str) -> Result<Command, (StatusCode, String)> {
        let headers =
            [(header::CONTENT_TYPE, "application/json; charset=utf-8".parse().unwrap())].into_iter().collect();
        read(&headers, body.as_bytes())
    }

    #[test]
    fn what_can_be_asked_is_understood() {
        assert_eq!(ask(r#"{"do": "pause"}"#), Ok(Command::Pause));
        assert_eq!(ask(r#"{"do": "take_out", "board": 7}"#), Ok(Command::TakeOut(BoardKey(7))));
        assert_eq!(ask(r#"{"do": "mode", "mode": "region"}"#), Ok(Command::Mode(Mode::Region)));
        assert_eq!(ask(r#"{"do": "samples", "samples": "exact"}"#), Ok(Command::Samples(Samples::Exact)));
        assert_eq!(ask(r#"{"do": "debug", "picture": "skips"}"#), Ok(Command::Debug(DebugPicture::Skips)));
    }

    #[test]
    fn what_can_not_is_refused_with_a_reason() {
        for (body, reason) in [
            ("", "as in {\"do\": \"pause\"}"),
            (r#"{"do": "explode"}"#, "unknown variant `explode`"),
            (r#"{"do": "take_out"}"#, "missing field `board`"),
            (r#"{"do": "take_out", "board": -1}"#, "invalid value"),
            (r#"{"do": "samples", "samples": "2"}"#, "possible are 1, 4, 8, 16, 64 or exact"),
            (r#"{"do": "debug", "picture": "x"}"#, "possible are off, depth, levels or skips"),
            (r#"{"do": "mode", "mode": "groups"}"#, "unknown variant `groups`"),
        ] {
            let (status, error) = ask(body).unwrap_err();
            assert!(status == StatusCode::BAD_REQUEST && error.contains(reason), "{body}: {error}");
        }
        let plain = read(&HeaderMap::new(), br#"{"do": "pause"}"#).unwrap_err();
        assert_eq!(plain.0, StatusCode::UNSUPPORTED_MEDIA_TYPE, "a form of a foreign page");
    }
}
