//! Answers that follow from the address and the store alone, kept until something is written that may change them: dashboards and
//! scripts ask for the same again and again.

use super::ApiError;
use crate::store::State;
use axum::{
    Extension,
    body::{Body, Bytes},
    extract,
    http::{HeaderMap, HeaderValue, Request, header},
    middleware::Next,
    response::{IntoResponse as _, Response},
};
use std::{
    collections::HashMap,
    panic::resume_unwind,
    sync::{Mutex, PoisonError},
};
use tokio_util::task::TaskTracker;
use tracing::Instrument as _;

/// Marks an answer that may be kept: nothing but the store, the address and the header `accept` decides what it says.
#[derive(Clone, Copy)]
pub enum FromStore {
    /// Whatever is written may change it.
    All,
    /// Whatever is written but posted results.
    Lasting,
}

/// What a handler adds to an answer that anything may change.
pub const FROM_STORE: Extension<FromStore> = Extension(FromStore::All);
/// And to one that posted results leave as it is.
pub const LASTING_FROM_STORE: Extension<FromStore> = Extension(FromStore::Lasting);

/// Larger answers with their questions are not kept, and with more of a kind all of that kind are forgotten: together at most 64 MiB.
const MAX_BYTES: usize = 256 << 10;
const MAX_ANSWERS: usize = 128;

/// Answers of the store as it is.
#[derive(Default)]
pub struct Answers {
    all: Mutex<Kept>,
    lasting: Mutex<Kept>,
}

/// Those of one state.
#[derive(Default)]
struct Kept {
    /// Its number.
    state: u64,
    answers: HashMap<Question, Answer>,
}

/// What tells one answer from another.
#[derive(Clone, PartialEq, Eq, Hash)]
pub struct Question {
    address: String,
    accept: Option<HeaderValue>,
}

impl Question {
    /// What a `GET` asks.
    pub fn of<B>(request: &Request<B>) -> Self {
        Self {
            address: request.uri().to_string(),
            accept: request.headers().get(header::ACCEPT).cloned(),
        }
    }

    fn n_bytes(&self) -> usize {
        self.address.len() + self.accept.as_ref().map_or(0, HeaderValue::len)
    }
}

/// A kept answer of status 200.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Answer {
    /// Its tag among them.
    pub headers: HeaderMap,
    /// Its content.
    pub body: Bytes,
}

impl Answers {
    /// The answer to a question in this state of the store.
    pub fn get(&self, state: State, question: &Question) -> Option<Answer> {
        let kept = |kept, state| at(kept, state, |answers| answers.get(question).cloned()).flatten();
        kept(&self.lasting, state.lasting).or_else(|| kept(&self.all, state.all))
    }

    /// Keeps an answer that was begun in this state. If there is another by now, nobody will be given it.
    pub fn keep(&self, state: State, kind: FromStore, question: Question, answer: &Answer) {
        if question.n_bytes() + answer.body.len() > MAX_BYTES {
            return;
        }
        let answer = Answer {
            headers: answer.headers.clone(),
            // The buffer that it was written to may be twice as long.
            body: Bytes::copy_from_slice(&answer.body),
        };
        let (kept, state) = match kind {
            FromStore::All => (&self.all, state.all),
            FromStore::Lasting => (&self.lasting, state.lasting),
        };
        at(kept, state, |answers| {
            if answers.len() == MAX_ANSWERS {
                answers.clear();
            }
            answers.insert(question, answer);
        });
    }
}

/// The answers of a state; none where it has no number, or there is a later one.
fn at<T>(kept: &Mutex<Kept>, state: Option<u64>, work: impl FnOnce(&mut HashMap<Question, Answer>) -> T) -> Option<T> {
    let state = state?;
    let mut kept = kept.lock().unwrap_or_else(PoisonError::into_inner);
    if kept.state < state {
        kept.state = state;
        kept.answers.clear();
    }
    (kept.state == state).then(|| work(&mut kept.answers))
}

/// Lets a request that may write end even if its client leaves, which a stopping service waits for as for all requests. Otherwise
/// SQLite would still make a commit that nobody waits for any more, after the state had its number.
pub async fn finish(
    extract::State(writes): extract::State<TaskTracker>,
    request: Request<Body>,
    next: Next,
) -> Response {
    if request.method().is_safe() {
        return next.run(request).await;
    }
    match writes.spawn(next.run(request).in_current_span()).await {
        Ok(response) => response,
        Err(error) => match error.try_into_panic() {
            Ok(panic) => resume_unwind(panic),
            Err(error) => ApiError::internal(error).into_response(),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::{Router, http::Method, middleware, routing::get};
    use std::sync::{
        Arc,
        atomic::{AtomicBool, Ordering::Relaxed},
    };
    use tokio::{sync::Notify, task::yield_now};
    use tower::ServiceExt as _;

    fn question(address: &str, accept: Option<&'static str>) -> Question {
        Question {
            address: address.to_owned(),
            accept: accept.map(HeaderValue::from_static),
        }
    }

    fn answer(n_bytes: usize) -> Answer {
        Answer {
            headers: HeaderMap::new(),
            body: vec![b'x'; n_bytes].into(),
        }
    }

    fn state(all: u64, lasting: u64) -> State {
        State {
            all: Some(all),
            lasting: Some(lasting),
        }
    }

    #[test]
    fn an_answer_lasts_until_the_next_write() {
        let answers = Answers::default();
        let (a, b) = (question("/a", None), question("/a", Some("text/csv")));
        answers.keep(state(3, 1), FromStore::All, a.clone(), &answer(1));
        assert_eq!(answers.get(state(3, 1), &a), Some(answer(1)));
        assert_eq!(answers.get(state(3, 1), &b), None, "another form");
        assert_eq!(answers.get(state(4, 1), &a), None, "after a write");
        answers.keep(state(3, 1), FromStore::All, a.clone(), &answer(1));
        assert_eq!(
            answers.get(state(4, 1), &a),
            None,
            "read before the write, and made after it"
        );
        assert_eq!(answers.get(state(3, 1), &a), None);
    }

    #[test]
    fn posted_results_leave_some_answers() {
        let answers = Answers::default();
        let (a, b) = (question("/a", None), question("/b", None));
        answers.keep(state(3, 1), FromStore::All, a.clone(), &answer(1));
        answers.keep(state(3, 1), FromStore::Lasting, b.clone(), &answer(2));
        let (all, lasting) = (None, Some(1));
        let now = State { all, lasting };
        assert_eq!(answers.get(now, &a), None, "while they are written");
        assert_eq!(answers.get(now, &b), Some(answer(2)));
        assert_eq!(answers.get(state(4, 1), &a), None);
        assert_eq!(answers.get(state(4, 1), &b), Some(answer(2)));
        assert_eq!(answers.get(State::default(), &b), None, "while anything is written");
        assert_eq!(answers.get(state(5, 2), &b), None);
    }

    #[test]
    fn memory_has_a_limit() {
        let answers = Answers::default();
        let keep = |address: &str, n_bytes| {
            answers.keep(state(1, 1), FromStore::All, question(address, None), &answer(n_bytes));
        };
        let has = |address: &str| answers.get(state(1, 1), &question(address, None)).is_some();
        keep("/large", MAX_BYTES);
        assert!(!has("/large"));
        keep("/small", 1);
        (1..MAX_ANSWERS).for_each(|i| keep(&i.to_string(), 1));
        assert!(has("/small"));
        keep("/one more", 1);
        assert!(!has("/small"));
    }

    /// Whether the handler of a request ends whose client left before it could.
    async fn ends_without_its_client(method: Method) -> bool {
        let (go, ended) = (Arc::new(Notify::new()), Arc::new(AtomicBool::new(false)));
        let writes = TaskTracker::new();
        let handler = {
            let (go, ended) = (Arc::clone(&go), Arc::clone(&ended));
            async move || {
                go.notified().await;
                ended.store(true, Relaxed);
            }
        };
        let router = Router::new()
            .route("/", get(handler.clone()).post(handler))
            .layer(middleware::from_fn_with_state(writes.clone(), finish));
        let request = Request::builder().method(&method).body(Body::empty()).unwrap();
        let client = tokio::spawn(router.oneshot(request));
        for _ in 0..10 {
            yield_now().await;
        }
        client.abort();
        assert!(client.await.unwrap_err().is_cancelled());
        writes.close();
        let stopped = tokio::spawn(async move { writes.wait().await });
        for _ in 0..10 {
            yield_now().await;
        }
        assert_eq!(stopped.is_finished(), method.is_safe(), "whether the service stops");
        go.notify_one();
        stopped.await.unwrap();
        ended.load(Relaxed)
    }

    #[tokio::test]
    async fn only_what_may_write_ends_without_its_client() {
        assert!(ends_without_its_client(Method::POST).await);
        assert!(!ends_without_its_client(Method::GET).await);
    }
}
