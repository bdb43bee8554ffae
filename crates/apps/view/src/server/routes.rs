//! The requests that the server answers.

use super::assets::{INDEX, file};
use super::guard::{Guard, check};
use crate::desk;
use crate::protocol::{Fault, FrameRequest, MapRequest, PathAnswer, PathRequest, SaveRequest};
use crate::save::save;
use crate::shared::Shared;
use axum::extract::rejection::JsonRejection;
use axum::extract::{Path, State};
use axum::http::StatusCode;
use axum::http::header::CONTENT_TYPE;
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{Html, IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router, middleware};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::Semaphore;
use tokio_stream::wrappers::WatchStream;
use tokio_stream::{Stream, StreamExt};

/// Computations at the same time. Others wait for their turn.
const AT_ONCE: usize = 2;
/// Requests at the same time that wait for the thread that renders. They hold no turn of the computations, so that pictures
/// are shown while a scene is loaded.
const WAITING: usize = 2;
/// Least time between two states of a page.
const STATE_EVERY: Duration = Duration::from_millis(200);

/// The state of all handlers.
#[derive(Clone)]
struct App {
    shared: Arc<Shared>,
    turns: Arc<Semaphore>,
    waits: Arc<Semaphore>,
}

/// The routes of the server.
pub(crate) fn router(shared: Arc<Shared>, guard: Guard) -> Router {
    let app = App { shared, turns: Arc::new(Semaphore::new(AT_ONCE)), waits: Arc::new(Semaphore::new(WAITING)) };
    Router::new()
        .route("/", get(|| async { Html(INDEX) }))
        .route("/assets/{name}", get(asset))
        .route("/api/state", get(state))
        .route("/api/events", get(events))
        .route("/api/frame", post(frame))
        .route("/api/map", post(map))
        .route("/api/probe", post(|app, body| answer(app, body, |shared, request| desk::probe(shared, &request))))
        .route("/api/regions", post(|app, body| answer(app, body, |shared, request| desk::regions(shared, &request))))
        .route("/api/line", post(|app, body| answer(app, body, |shared, request| desk::line(shared, &request))))
        .route("/api/path", post(path))
        .route(
            "/api/photon-transfer",
            post(|app, body| answer(app, body, |shared, request| desk::photon_transfer(shared, &request))),
        )
        .route("/api/scene", post(|app, body| answer(app, body, |s, request| desk::scene(s, request).map(done))))
        .route("/api/render", post(|app, body| answer(app, body, |s, request| desk::render(s, request).map(done))))
        .route("/api/target", post(|app, body| answer(app, body, |s, request| desk::target(s, request).map(done))))
        .route("/api/save", post(|app, body| answer(app, body, |shared, request: SaveRequest| save(shared, &request))))
        .layer(middleware::from_fn_with_state(guard, check))
        .with_state(app)
}

/// The answer of a request that only changes something.
#[derive(Serialize)]
struct Done {}

fn done((): ()) -> Done {
    Done {}
}

async fn asset(Path(name): Path<String>) -> Response {
    match file(&name) {
        Some((kind, content)) => ([(CONTENT_TYPE, kind)], content).into_response(),
        None => StatusCode::NOT_FOUND.into_response(),
    }
}

async fn state(State(app): State<App>) -> Response {
    Json(app.shared.state()).into_response()
}

/// The states, as server-sent events. A page that reads slowly gets the newest state when it reads again.
async fn events(State(app): State<App>) -> Sse<impl Stream<Item = Result<Event, Infallible>>> {
    let changes = WatchStream::new(app.shared.changed.subscribe()).throttle(STATE_EVERY);
    // The state is that of the moment at which the event is sent.
    let states =
        changes.map(move |_| Ok(Event::default().event("state").json_data(app.shared.state()).unwrap_or_default()));
    Sse::new(states).keep_alive(KeepAlive::default())
}

/// Runs a computation when it is its turn.
async fn compute<T: Send + 'static>(
    app: App,
    work: impl FnOnce(&Arc<Shared>) -> Result<T, Fault> + Send + 'static,
) -> Result<T, Fault> {
    run(app.shared, app.turns, work).await
}

/// Runs work on a thread that may wait, when `turns` has a place.
async fn run<T: Send + 'static>(
    shared: Arc<Shared>,
    turns: Arc<Semaphore>,
    work: impl FnOnce(&Arc<Shared>) -> Result<T, Fault> + Send + 'static,
) -> Result<T, Fault> {
    let failed = || Fault::new("the computation has failed", "reload the page");
    let turn = turns.acquire_owned().await.map_err(|_| failed())?;
    // The work goes on if the page is closed, and keeps its turn.
    let work = move || {
        let _turn = turn;
        work(&shared)
    };
    tokio::task::spawn_blocking(work).await.map_err(|_| failed())?
}

/// The answer of a request that cannot be met now, or not at all.
struct Refusal(StatusCode, Fault);

impl From<Fault> for Refusal {
    fn from(fault: Fault) -> Self {
        Self(if fault.is_early { StatusCode::CONFLICT } else { StatusCode::UNPROCESSABLE_ENTITY }, fault)
    }
}

impl From<JsonRejection> for Refusal {
    fn from(error: JsonRejection) -> Self {
        Self(error.status(), Fault::new(error.body_text(), "reload the page"))
    }
}

impl IntoResponse for Refusal {
    fn into_response(self) -> Response {
        (self.0, Json(self.1)).into_response()
    }
}

/// The body of a request.
type Body<T> = Result<Json<T>, JsonRejection>;

async fn answer<Q, A>(
    State(app): State<App>,
    body: Body<Q>,
    work: fn(&Arc<Shared>, Q) -> Result<A, Fault>,
) -> Result<Json<A>, Refusal>
where
    Q: DeserializeOwned + Send + 'static,
    A: Serialize + Send + 'static,
{
    let Json(request) = body?;
    Ok(Json(compute(app, move |shared| work(shared, request)).await?))
}

async fn path(State(app): State<App>, body: Body<PathRequest>) -> Result<Json<PathAnswer>, Refusal> {
    let Json(request) = body?;
    Ok(Json(run(app.shared, app.waits, move |shared| desk::path(shared, &request)).await?))
}

async fn frame(State(app): State<App>, body: Body<FrameRequest>) -> Result<Response, Refusal> {
    let Json(request) = body?;
    Ok(binary(compute(app, move |shared| desk::frame(shared, &request)).await?))
}

async fn map(State(app): State<App>, body: Body<MapRequest>) -> Result<Response, Refusal> {
    let Json(request) = body?;
    Ok(binary(compute(app, move |shared| desk::map(shared, &request)).await?))
}

/// The length of a header, the header as JSON, and the numbers from the next multiple of four bytes on.
fn binary<H: Serialize>((header, payload): (H, Vec<u8>)) -> Response {
    let Ok(header) = serde_json::to_vec(&header) else { return StatusCode::INTERNAL_SERVER_ERROR.into_response() };
    let mut bytes = Vec::with_capacity(payload.len() + header.len() + 8);
    bytes.extend((header.len() as u32).to_le_bytes());
    bytes.extend(header);
    bytes.resize(bytes.len().next_multiple_of(4), 0);
    bytes.extend(payload);
    ([(CONTENT_TYPE, "application/octet-stream")], bytes).into_response()
}
