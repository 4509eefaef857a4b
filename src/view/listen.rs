//! Connections to the page's server: so many at a time, each with so long to say what it wants, in so many bytes.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Semaphore;
use tokio::time::{sleep, timeout};

/// Connections at a time; others wait. Sockets of the robot that is driven are counted elsewhere.
const MOST: usize = 64;
/// How long a client may take for the head of a request, and be idle between requests.
const HEAD: Duration = Duration::from_secs(10);
/// Largest head of a request, bytes; browsers send a tenth of it.
const HEAD_BYTES: usize = 16 << 10;
/// How long a connection may last, a download over a slow line among them.
const LONGEST: Duration = Duration::from_secs(600);
/// Pause after the system gave no connection, as when there are too many open files.
const PAUSE: Duration = Duration::from_millis(100);

/// Answers whoever connects to `listener` by `routes`, for ever.
///
/// # Errors
/// None so far: what goes wrong with one connection is its own.
pub async fn serve(listener: TcpListener, routes: Router) -> io::Result<()> {
    let room = Arc::new(Semaphore::new(MOST));
    loop {
        let permit = room.clone().acquire_owned().await.map_err(io::Error::other)?;
        let Ok((stream, _)) = listener.accept().await else {
            sleep(PAUSE).await;
            continue;
        };
        let routes = routes.clone();
        tokio::spawn(async move {
            let _permit = permit;
            let _ = timeout(LONGEST, answer(stream, routes)).await;
        });
    }
}

/// Ends when the client has gone, was too slow, or went over to a socket.
async fn answer(stream: TcpStream, routes: Router) -> hyper::Result<()> {
    http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(HEAD)
        .max_buf_size(HEAD_BYTES)
        .serve_connection(TokioIo::new(stream), TowerToHyperService::new(routes))
        .with_upgrades()
        .await
}
