//! What the robot tells, for Foxglove: the messages of a log over its websocket protocol. It takes no commands.

use std::collections::BTreeMap;
use std::net::IpAddr;
use std::sync::Arc;
use std::time::{SystemTime, UNIX_EPOCH};

use foxglove::websocket::{ChannelView, Client, ServerListener};
use foxglove::{Context, FoxgloveError, PartialMetadata, RawChannel};
use miette::{IntoDiagnostic, WrapErr};
use omniwalk_sim2real::log::Message;

/// The port that Foxglove suggests.
pub const PORT: u16 = 8765;
/// Messages that wait for a slow client before the oldest are dropped: two seconds.
const BACKLOG: usize = 512;

/// Channels to whoever listens.
pub struct Live {
    channels: BTreeMap<&'static str, Arc<RawChannel>>,
    epoch: u64,
    /// The server and the channels find each other through it, and do not keep it.
    _context: Arc<Context>,
}

impl Live {
    /// Listens at `ip`, on `port` or else on the one Foxglove suggests or any that is free, for listeners to robot `name`.
    /// `samples` has one message of each topic; `description` is sent to each that subscribes to it.
    ///
    /// # Errors
    /// When the port is taken.
    pub async fn start(
        ip: IpAddr,
        port: Option<u16>,
        name: &str,
        samples: &[Message],
        description: &Message,
    ) -> miette::Result<(Self, u16)> {
        let context = Context::new();
        let mut channels = BTreeMap::new();
        for message in samples.iter().chain([description]) {
            channels.insert(message.topic(), channel(&context, message).into_diagnostic()?);
        }
        let listener = Arc::new(Describer {
            channel: channels[description.topic()].clone(),
            bytes: description.bytes().into_diagnostic()?,
        });
        let open = |port| {
            let server = context.websocket_server().name(format!("omniwalk: {name}"));
            let server = server.message_backlog_size(BACKLOG).listener(listener.clone());
            server.bind(ip.to_string(), port).start()
        };
        let mut handle = open(port.unwrap_or(PORT)).await;
        if handle.is_err() && port.is_none() {
            handle = open(0).await;
        }
        let handle = handle
            .into_diagnostic()
            .wrap_err_with(|| format!("cannot listen at {ip} port {}", port.unwrap_or(PORT)))?;
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let live = Self {
            channels,
            epoch: since.as_nanos() as u64,
            _context: context,
        };
        Ok((live, handle.port()))
    }

    /// Wall time at the simulation's beginning, ns.
    pub fn epoch(&self) -> u64 {
        self.epoch
    }

    /// Whether anybody listens.
    pub fn is_watched(&self) -> bool {
        self.channels.values().any(|channel| channel.has_sinks())
    }

    /// Sends a message stamped `time`, ns.
    pub fn send(&self, time: u64, message: &Message) {
        let Some(channel) = self.channels.get(message.topic()).filter(|channel| channel.has_sinks()) else {
            return;
        };
        if let Ok(bytes) = message.bytes() {
            channel.log_with_meta(&bytes, PartialMetadata::with_log_time(time));
        }
    }
}

fn channel(context: &Arc<Context>, message: &Message) -> Result<Arc<RawChannel>, FoxgloveError> {
    let schema = message.schema();
    context
        .channel_builder(message.topic())
        .message_encoding(schema.message_encoding)
        .schema(foxglove::Schema::new(
            schema.name,
            schema.encoding,
            schema.text.into_bytes(),
        ))
        .build_raw()
}

/// Sends the robot's description to each client that subscribes to it: it does not change.
struct Describer {
    channel: Arc<RawChannel>,
    bytes: Vec<u8>,
}

impl ServerListener for Describer {
    fn on_subscribe(&self, client: Client, channel: ChannelView) {
        if channel.topic() == self.channel.topic() {
            self.channel.log_to_sink(&self.bytes, client.sink_id());
        }
    }
}
