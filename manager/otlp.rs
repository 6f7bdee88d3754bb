//! Traces to a collector: each frame as a trace, over OTLP (HTTP, JSON), a second's frames at a time.
//!
//! It asks the engine as the console does, on a thread that yields to whatever makes frames. What a collector doesn't take is dropped: a rig flies, with
//! or without.

use crate::backplane::desk::{Desk, Silence};
use crate::backplane::spans::{Span, Track, spans};
use crate::backplane::trace::FrameTrace;
use opentelemetry::trace::{SpanContext, SpanId, SpanKind, Status, TraceFlags, TraceId, TraceState};
use opentelemetry::{InstrumentationScope, KeyValue};
use opentelemetry_http::hyper::HyperClient;
use opentelemetry_otlp::{Protocol, SpanExporter, WithExportConfig, WithHttpConfig};
use opentelemetry_sdk::Resource;
use opentelemetry_sdk::trace::{SpanData, SpanEvents, SpanExporter as _, SpanLinks};
use proto::ids::FrameNumber;
use proto::time::Time;
use std::collections::BTreeMap;
use std::io;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

/// How often frames are sent.
const PERIOD: Duration = Duration::from_secs(1);
/// A collector that hasn't answered by then gets the next ones.
const TIMEOUT: Duration = Duration::from_secs(5);
/// Spans in one request: about a megabyte.
const BATCH: usize = 2000;
/// A frame that hasn't been shown when so many have been opened after it never will be.
const OVERTAKEN: usize = 16;

/// Starts sending to a collector at `url`; ends with the rig.
///
/// # Errors
/// When the address is none, or the thread can't be started.
pub(crate) fn start(url: &str, desk: Desk) -> io::Result<()> {
    let endpoint = endpoint(url)?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    std::thread::Builder::new().name("otlp".into()).spawn(move || {
        pool::turns::go_behind();
        if let Err(error) = runtime.block_on(send(&endpoint, &desk)) {
            tracing::error!(error, "traces are not sent");
        }
    })?;
    Ok(())
}

/// Where traces go, with the usual path where none is given.
fn endpoint(url: &str) -> io::Result<String> {
    let wrong = || {
        io::Error::new(io::ErrorKind::InvalidInput, format!("{url:?}: expected an address like http://collector:4318"))
    };
    let rest = url.strip_prefix("http://").filter(|rest| !rest.is_empty()).ok_or_else(wrong)?;
    let has_path = rest.trim_end_matches('/').contains('/');
    Ok(if has_path { url.to_owned() } else { format!("{}/v1/traces", url.trim_end_matches('/')) })
}

async fn send(endpoint: &str, desk: &Desk) -> Result<(), String> {
    let client = HyperClient::with_default_connector(TIMEOUT, None);
    let built = SpanExporter::builder()
        .with_http()
        .with_http_client(client)
        .with_protocol(Protocol::HttpJson)
        .with_endpoint(endpoint)
        .with_timeout(TIMEOUT)
        .build();
    let mut exporter = built.map_err(|error| error.to_string())?;
    let attributes = [KeyValue::new("service.version", env!("CARGO_PKG_VERSION"))];
    exporter.set_resource(&Resource::builder().with_service_name("cyclorama").with_attributes(attributes).build());
    let mut writer = None;
    let (mut sent, mut is_refused) = (Time(0), false);
    let mut ticks = tokio::time::interval(PERIOD);
    loop {
        ticks.tick().await;
        let (now, frames) = match (desk.live().await, desk.traces().await) {
            (Ok(live), Ok(frames)) => (live.now, frames),
            (Err(Silence::Ended), _) | (_, Err(Silence::Ended)) => return Ok(()),
            _ => continue,
        };
        let writer = writer.get_or_insert_with(|| Writer::new(now));
        let fresh = complete(&frames, sent);
        sent = fresh.last().map_or(sent, |trace| trace.opened);
        for batch in writer.write(&spans(fresh.iter().map(AsRef::as_ref))).chunks(BATCH) {
            match exporter.export(batch.to_vec()).await {
                Ok(()) => is_refused = false,
                // Once, and again when it has worked in between.
                Err(error) if !is_refused => {
                    is_refused = true;
                    tracing::warn!(%error, endpoint, "the collector does not take traces; they are dropped");
                }
                Err(_) => {}
            }
        }
    }
}

/// Frames that were opened after a moment and that nothing more will happen to.
fn complete(frames: &[Arc<FrameTrace>], after: Time) -> Vec<Arc<FrameTrace>> {
    let is_over =
        |(place, trace): &(usize, &Arc<FrameTrace>)| trace.presented.is_some() || place + OVERTAKEN < frames.len();
    let fresh = frames.iter().enumerate().skip_while(|(_, trace)| trace.opened <= after);
    fresh.take_while(is_over).map(|(_, trace)| Arc::clone(trace)).collect()
}

/// Writes spans as the protocol has them.
struct Writer {
    /// When the manager's clock was zero.
    zero: SystemTime,
    /// Tells this rig's traces from others'.
    rig: u64,
    scope: InstrumentationScope,
}

impl Writer {
    fn new(now: Time) -> Self {
        let zero = SystemTime::now().checked_sub(Duration::from_nanos(now.0)).unwrap_or(SystemTime::UNIX_EPOCH);
        let since = zero.duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        let seed = [since.as_nanos().to_le_bytes().as_slice(), &std::process::id().to_le_bytes()].concat();
        let mut rig = [0; 8];
        rig.copy_from_slice(&blake3::hash(&seed).as_bytes()[..8]);
        Self { zero, rig: u64::from_le_bytes(rig) | 1, scope: InstrumentationScope::builder("cyclorama").build() }
    }

    /// A trace for each frame: its root from the packet to the picture, below it who did something, below those their stages.
    fn write(&self, spans: &[Span]) -> Vec<SpanData> {
        let mut frames: BTreeMap<FrameNumber, Vec<&Span>> = BTreeMap::new();
        for span in spans {
            frames.entry(span.frame).or_default().push(span);
        }
        let mut out = Vec::new();
        for (frame, parts) in frames {
            let trace = TraceId::from(u128::from(self.rig) << 64 | u128::from(frame.0 + 1));
            let mut count = 0;
            let mut put = |parent: SpanId, name: &'static str, begin: u64, end: u64, attributes: Vec<KeyValue>| {
                count += 1;
                let id = SpanId::from(count);
                out.push(self.span(trace, id, parent, name, begin, end, attributes));
                id
            };
            let begin = parts.iter().map(|part| part.begin_ns).min().unwrap_or(0);
            let end = parts.iter().map(|part| part.end_ns).max().unwrap_or(0);
            let number = KeyValue::new("cyclorama.frame", frame.0 as i64);
            let root = put(SpanId::INVALID, "frame", begin, end, vec![number]);
            for part in parts {
                let mut about: Vec<_> = part
                    .notes
                    .iter()
                    .map(|(name, value)| KeyValue::new(format!("cyclorama.{name}"), *value as i64))
                    .collect();
                let name = match &part.track {
                    Track::Frames(_) => "open to swap",
                    Track::Board(board) => {
                        about.push(KeyValue::new("cyclorama.board", board.to_string()));
                        part.name
                    }
                    Track::Host | Track::Compositor => part.name,
                };
                let id = put(root, name, part.begin_ns, part.end_ns, about);
                for stage in &part.stages {
                    let view = stage.view.map(|view| KeyValue::new("cyclorama.view", i64::from(view)));
                    put(id, stage.name, stage.begin_ns, stage.end_ns, view.into_iter().collect());
                }
            }
        }
        out
    }

    fn span(
        &self,
        trace: TraceId,
        id: SpanId,
        parent: SpanId,
        name: &'static str,
        begin: u64,
        end: u64,
        attributes: Vec<KeyValue>,
    ) -> SpanData {
        SpanData {
            span_context: SpanContext::new(trace, id, TraceFlags::SAMPLED, false, TraceState::NONE),
            parent_span_id: parent,
            parent_span_is_remote: false,
            span_kind: SpanKind::Internal,
            name: name.into(),
            start_time: self.zero + Duration::from_nanos(begin),
            end_time: self.zero + Duration::from_nanos(end),
            attributes,
            dropped_attributes_count: 0,
            events: SpanEvents::default(),
            links: SpanLinks::default(),
            status: Status::Unset,
            instrumentation_scope: self.scope.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_gets_the_usual_path() {
        assert_eq!(endpoint("http://collector:4318").unwrap(), "http://collector:4318/v1/traces");
        assert_eq!(endpoint("http://collector:4318/").unwrap(), "http://collector:4318/v1/traces");
        assert_eq!(endpoint("http://collector/otlp/v1/traces").unwrap(), "http://collector/otlp/v1/traces");
        for wrong in ["collector:4318", "https://collector", "http://", ""] {
            assert!(endpoint(wrong).unwrap_err().to_string().contains("http://collector:4318"), "{wrong}");
        }
    }
}
