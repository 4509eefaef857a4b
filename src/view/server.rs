//! The page, the logs and the robot's socket, over HTTP.
//!
//! Everything but the files of the page needs the token. A request holds no path: it names a file of the page, which is
//! found in a table, or the number of a log.

use std::sync::Arc;
use std::sync::mpsc::SyncSender;
use std::time::Duration;

use axum::Router;
use axum::body::Bytes;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::extract::{Path, Query, Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use serde::Deserialize;
use serde_json::json;
use tokio::sync::broadcast::error::RecvError;
use tokio::sync::{Semaphore, broadcast, watch};
use tokio::time::timeout;

use super::assets;
use super::clips::Clips;
use super::orders::{LONGEST, Limits, Order};

/// Sockets at a time.
const MOST_SOCKETS: usize = 16;
/// Logs that are read at a time.
const MOST_READERS: usize = 2;
/// A client that takes nothing for this long is left.
const STUCK: Duration = Duration::from_secs(10);

/// Nothing from elsewhere is loaded or asked, and nobody learns the address with its token.
const HEADERS: [(HeaderName, &str); 4] = [
    (
        header::CONTENT_SECURITY_POLICY,
        "default-src 'self'; img-src 'self' data: blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    ),
    (header::REFERRER_POLICY, "no-referrer"),
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::CACHE_CONTROL, "no-store"),
];

/// What requests are answered from.
pub struct Served {
    /// What whoever asks has to know.
    pub token: String,
    /// The robot, see [`super::describe`].
    pub robot: String,
    /// The logs.
    pub clips: Arc<Clips>,
    /// The robot that walks, if there is a policy.
    pub ride: Option<Ride>,
}

/// A way to the thread of the robot that walks.
pub struct Ride {
    /// Where orders go.
    pub orders: SyncSender<Order>,
    /// Rows for whoever looks.
    pub frames: broadcast::Sender<Bytes>,
    /// The newest report.
    pub reports: watch::Receiver<String>,
    /// What orders may ask for.
    pub limits: Limits,
}

struct App {
    served: Served,
    sockets: Arc<Semaphore>,
    readers: Semaphore,
}

#[derive(Deserialize)]
struct Credentials {
    token: Option<String>,
}

/// The routes.
pub fn routes(served: Served) -> Router {
    let app = Arc::new(App {
        served,
        sockets: Arc::new(Semaphore::new(MOST_SOCKETS)),
        readers: Semaphore::new(MOST_READERS),
    });
    let guarded = Router::new()
        .route("/robot", get(robot))
        .route("/clips", get(clips))
        .route("/clips/{index}", get(rows))
        .route("/clips/{index}/log", get(log))
        .route("/drive", get(drive))
        .layer(middleware::from_fn_with_state(app.clone(), admit));
    Router::new()
        .route("/", get(|| file("")))
        .route(
            "/{name}",
            get(|Path(name): Path<String>| async move { file(&name).await }),
        )
        .nest("/api", guarded)
        .layer(middleware::from_fn(dress))
        .with_state(app)
}

async fn dress(request: Request, next: Next) -> Response {
    let mut response = next.run(request).await;
    let headers = HEADERS.map(|(name, value)| (name, HeaderValue::from_static(value)));
    response.headers_mut().extend(headers);
    response
}

async fn admit(
    State(app): State<Arc<App>>,
    Query(credentials): Query<Credentials>,
    request: Request,
    next: Next,
) -> Response {
    match credentials.token {
        Some(token) if same(token.as_bytes(), app.served.token.as_bytes()) => next.run(request).await,
        _ => (
            StatusCode::FORBIDDEN,
            "the address lacks the token: open the one that omniwalk view has printed\n",
        )
            .into_response(),
    }
}

/// Compares without telling by its time how much was right.
fn same(a: &[u8], b: &[u8]) -> bool {
    a.len() == b.len() && a.iter().zip(b).fold(0, |difference, (a, b)| difference | (a ^ b)) == 0
}

async fn file(name: &str) -> Response {
    let Some(asset) = assets::find(name) else {
        return (StatusCode::NOT_FOUND, "there is no such page\n").into_response();
    };
    let mut headers = HeaderMap::new();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(asset.kind));
    if asset.compressed {
        headers.insert(header::CONTENT_ENCODING, HeaderValue::from_static("gzip"));
    }
    (headers, asset.bytes).into_response()
}

fn json_text(text: String) -> Response {
    ([(header::CONTENT_TYPE, "application/json")], text).into_response()
}

async fn robot(State(app): State<Arc<App>>) -> Response {
    json_text(app.served.robot.clone())
}

async fn clips(State(app): State<Arc<App>>) -> Response {
    json_text(app.served.clips.names().to_string())
}

async fn rows(State(app): State<Arc<App>>, Path(index): Path<usize>) -> Response {
    read(&app, index, |clips, path| {
        clips.rows(path).map_err(|error| format!("{error}\n"))
    })
    .await
}

async fn log(State(app): State<Arc<App>>, Path(index): Path<usize>) -> Response {
    let response = read(&app, index, |_, path| {
        std::fs::read(path).map_err(|error| format!("{}: {error}\n", path.display()))
    });
    let name = format!("attachment; filename=\"log-{index}.mcap\"");
    ([(header::CONTENT_DISPOSITION, name)], response.await).into_response()
}

/// The bytes that `work` makes of log `index`, beside everything else.
async fn read(
    app: &App,
    index: usize,
    work: impl FnOnce(&Clips, &std::path::Path) -> Result<Vec<u8>, String> + Send + 'static,
) -> Response {
    let Some(path) = app.served.clips.path(index) else {
        return (StatusCode::NOT_FOUND, "there is no such log\n").into_response();
    };
    let Ok(_permit) = app.readers.acquire().await else {
        return StatusCode::SERVICE_UNAVAILABLE.into_response();
    };
    let clips = app.served.clips.clone();
    match tokio::task::spawn_blocking(move || work(&clips, &path)).await {
        Ok(Ok(bytes)) => ([(header::CONTENT_TYPE, "application/octet-stream")], bytes).into_response(),
        Ok(Err(why)) => (StatusCode::UNPROCESSABLE_ENTITY, why).into_response(),
        Err(_) => StatusCode::INTERNAL_SERVER_ERROR.into_response(),
    }
}

async fn drive(State(app): State<Arc<App>>, upgrade: WebSocketUpgrade) -> Response {
    if app.served.ride.is_none() {
        return (StatusCode::NOT_FOUND, "there is no policy to drive\n").into_response();
    }
    let Ok(permit) = app.sockets.clone().try_acquire_owned() else {
        return (StatusCode::SERVICE_UNAVAILABLE, "too many are looking already\n").into_response();
    };
    let upgrade = upgrade.max_message_size(LONGEST).max_frame_size(LONGEST);
    upgrade.on_upgrade(async move |socket| {
        let _permit = permit;
        if let Some(ride) = &app.served.ride {
            accompany(socket, ride).await;
        }
    })
}

/// Sends rows and reports, takes orders, until the client has gone or takes nothing any more.
async fn accompany(mut socket: WebSocket, ride: &Ride) {
    let mut frames = ride.frames.subscribe();
    let mut reports = ride.reports.clone();
    reports.mark_changed();
    let hello = json!({ "type": "hello", "limits": ride.limits });
    let mut next = Some(text(hello.to_string()));
    loop {
        if let Some(message) = next.take() {
            match timeout(STUCK, socket.send(message)).await {
                Ok(Ok(())) => {}
                _ => return,
            }
        }
        next = tokio::select! {
            incoming = socket.recv() => match incoming {
                Some(Ok(Message::Text(order))) => take(&order, ride),
                Some(Ok(Message::Binary(_))) => Some(trouble("orders are texts")),
                Some(Ok(Message::Close(_)) | Err(_)) | None => return,
                Some(Ok(Message::Ping(_) | Message::Pong(_))) => None,
            },
            frame = frames.recv() => match frame {
                Ok(row) => Some(Message::Binary(row)),
                // It was too slow for these; the next ones are newer.
                Err(RecvError::Lagged(_)) => None,
                Err(RecvError::Closed) => return,
            },
            changed = reports.changed() => match changed {
                Ok(()) => Some(text(reports.borrow_and_update().clone())),
                Err(_) => return,
            },
        };
    }
}

/// Passes an order on; what is wrong with it goes back.
fn take(order: &str, ride: &Ride) -> Option<Message> {
    match ride.limits.parse(order) {
        Err(why) => Some(trouble(&why)),
        Ok(order) => match ride.orders.try_send(order) {
            Ok(()) => None,
            Err(_) => Some(trouble("too many orders at a time")),
        },
    }
}

fn trouble(why: &str) -> Message {
    text(json!({ "type": "error", "why": why }).to_string())
}

fn text(text: String) -> Message {
    Message::Text(text.into())
}
