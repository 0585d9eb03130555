//! The identification of the load beside the control interrupt: a task that works in pieces of less than a millisecond and
//! gives way to every other task between two of them. What it does is in `shared::load`.

use core::{
    mem::MaybeUninit,
    sync::atomic::{AtomicBool, Ordering},
};

use embassy_futures::yield_now;
use embassy_time::{Duration, Timer};
use heapless::spsc::{Consumer, Producer, Queue};
use shared::{
    board::LoadOrder,
    load::{Identifier, LoadNews, LoadRow, Piece},
};

/// How often to look whether there are rows: seven of the longest period.
const LOOK_EVERY: Duration = Duration::from_millis(5);

/// Between two pieces of a search: sending a frame takes several turns of its task, and rows go out every 0.7 ms.
const PAUSE: Duration = Duration::from_micros(150);

/// Between control interrupt and task, in static memory. A queue of N holds N - 1.
pub struct Load {
    orders: Queue<LoadOrder, 2>,
    rows: Queue<LoadRow, 64>,
    news: Queue<LoadNews, 4>,
}

impl Load {
    /// With nothing to do.
    pub const fn new() -> Self {
        Self { orders: Queue::new(), rows: Queue::new(), news: Queue::new() }
    }

    /// The ends for the control interrupt and for the task.
    pub fn split(&'static mut self) -> (ControlEnd, TaskEnd) {
        let (order_producer, orders) = self.orders.split();
        let (row_producer, rows) = self.rows.split();
        let (news_producer, news) = self.news.split();
        (ControlEnd { orders: order_producer, rows: row_producer, news }, TaskEnd { orders, rows, news: news_producer })
    }
}

/// The control interrupt's end.
pub struct ControlEnd {
    orders: Producer<'static, LoadOrder>,
    rows: Producer<'static, LoadRow>,
    news: Consumer<'static, LoadNews>,
}

impl ControlEnd {
    /// What the task has to tell.
    pub fn news(&mut self) -> Option<LoadNews> {
        // Most often there is none, and nothing is to be copied then.
        if self.news.ready() { self.news.dequeue() } else { None }
    }

    /// Passes on a row. One for which there is no room is missed by the task, which then begins anew.
    pub fn row(&mut self, row: LoadRow) {
        let _ = self.rows.enqueue(row);
    }

    /// Passes on an order, if there is one and room for it; otherwise it is asked for again.
    pub fn order(&mut self, order: impl FnOnce() -> Option<LoadOrder>) {
        if self.orders.ready()
            && let Some(order) = order()
        {
            let _ = self.orders.enqueue(order);
        }
    }
}

/// Memory beside the stack, where there is room for the rows it collects. Nothing initialises it.
#[unsafe(link_section = ".core_coupled")]
static mut IDENTIFIER: MaybeUninit<Identifier> = MaybeUninit::uninit();

/// The identification, for the task. Call it once.
///
/// # Panics
/// When it is called again.
pub fn identifier() -> &'static mut Identifier {
    static TAKEN: AtomicBool = AtomicBool::new(false);
    assert!(!TAKEN.swap(true, Ordering::Relaxed), "taken once");
    let place = &raw mut IDENTIFIER;
    // SAFETY: nobody else has a reference, because this line is reached once.
    let place = unsafe { &mut *place };
    place.write(Identifier::new())
}

/// The task's end.
pub struct TaskEnd {
    orders: Consumer<'static, LoadOrder>,
    rows: Consumer<'static, LoadRow>,
    news: Producer<'static, LoadNews>,
}

/// Identifies what the board orders.
#[embassy_executor::task]
pub async fn identify(identifier: &'static mut Identifier, mut end: TaskEnd) {
    loop {
        match end.orders.dequeue() {
            Some(LoadOrder::Begin(setup)) => identifier.begin(&setup),
            Some(LoadOrder::End) => identifier.end(),
            None => {}
        }
        if let Some(row) = end.rows.dequeue() {
            tell(&mut end.news, identifier.push(&row));
            yield_now().await;
        } else if identifier.has_work() {
            tell(&mut end.news, identifier.advance());
            Timer::after(PAUSE).await;
        } else {
            Timer::after(LOOK_EVERY).await;
        }
    }
}

fn tell(news: &mut Producer<'static, LoadNews>, piece: Piece) {
    if let Some(told) = piece.news {
        // The interrupt takes one every period, and there are never several in so short a time.
        let _ = news.enqueue(told);
    }
}
