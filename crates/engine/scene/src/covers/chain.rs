//! Chains of smooth interfaces as sequences of events: the event at each interface, from the receiver to the light.

/// The events at the interfaces between two points: at each interface light is transmitted or reflected.
///
/// Events are in the order in which they occur from the receiver to the light. A path traced from the receiver appends
/// its events with [`Self::extended`].
#[derive(Clone, Copy, PartialEq, Eq, Hash, serde::Serialize)]
pub struct Chain(pub(super) u16);

/// Maximum number of reflections. The number is even: none, two for one double pass, four for two.
const MAX_REFLECTIONS: u32 = 4;

impl Chain {
    /// Maximum number of events.
    pub const MAX_EVENTS: u32 = 14;

    /// A chain without events.
    pub const EMPTY: Self = Self(1);

    /// The chain with one more event at its end; `None` if it would be too long.
    #[inline]
    pub fn extended(self, is_reflection: bool) -> Option<Self> {
        (self.events() < Self::MAX_EVENTS).then(|| {
            // The highest set bit is a mark. The bits below it are the events, the first one in the lowest bit.
            let mark = 1 << self.events();
            Self((self.0 & !mark) | (mark << 1) | if is_reflection { mark } else { 0 })
        })
    }

    /// Number of events.
    #[inline]
    pub fn events(self) -> u32 {
        15 - self.0.leading_zeros()
    }

    /// True if the event of this number (from 0, at the receiver) is a reflection. False beyond the end.
    #[inline]
    pub fn is_reflection(self, event: u32) -> bool {
        event < self.events() && self.0 >> event & 1 == 1
    }

    /// Number of double passes: half the number of reflections.
    #[inline]
    pub fn order(self) -> u32 {
        (self.0.count_ones() - 1) / 2
    }

    /// All chains up to order 2 that pass `interfaces` interfaces in a row, in ascending order. Empty without
    /// interfaces, or with too many.
    ///
    /// Each chain starts before the first interface and ends behind the last one. It has an even number of reflections.
    /// It uses no other interface.
    pub(crate) fn through(interfaces: u32) -> Vec<Self> {
        let mut found = Vec::new();
        if interfaces > 0 {
            enumerate(interfaces, 0, true, Self::EMPTY, 0, &mut found);
        }
        found.sort_by_key(|c| (c.order(), c.events(), c.0));
        found
    }

    /// The events of the chain one by one, in a row of `interfaces` interfaces: the number of each interface (from 0,
    /// at the receiver), whether the event is a reflection, and whether light meets it in forward direction.
    #[inline(always)]
    pub(crate) fn steps(self) -> impl Iterator<Item = Step> {
        let mut forward = true;
        let mut next = 0u32;
        (0..self.events()).map(move |event| {
            let is_reflection = self.is_reflection(event);
            let step = Step { interface: next, is_reflection, forward };
            forward ^= is_reflection;
            next = if forward { next + 1 } else { next.wrapping_sub(1) };
            step
        })
    }
}

/// One event of a chain at its interface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Step {
    pub(crate) interface: u32,
    pub(crate) is_reflection: bool,
    /// True if the interface is hit from the receiver's side.
    pub(crate) forward: bool,
}

impl Step {
    /// The layer that light enters, counted from that of the receiver: the one behind the interface after a forward
    /// step, the one before it after a backward step.
    #[inline(always)]
    pub(crate) fn layer_behind(&self) -> usize {
        self.interface as usize + usize::from(self.forward != self.is_reflection)
    }
}

impl std::fmt::Debug for Chain {
    /// `TRRT`.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        (0..self.events()).try_for_each(|e| f.write_str(if self.is_reflection(e) { "R" } else { "T" }))
    }
}

/// Continues from interface `next` with all sequences that can be completed.
fn enumerate(interfaces: u32, next: u32, forward: bool, chain: Chain, reflections: u32, found: &mut Vec<Chain>) {
    let Some(transmitted) = chain.extended(false) else { return };
    if forward {
        if next + 1 == interfaces {
            found.push(transmitted);
        } else {
            enumerate(interfaces, next + 1, true, transmitted, reflections, found);
        }
    } else if next > 0 {
        enumerate(interfaces, next - 1, false, transmitted, reflections, found);
    }
    let Some(reflected) = chain.extended(true).filter(|_| reflections < MAX_REFLECTIONS) else { return };
    if !forward {
        enumerate(interfaces, next + 1, true, reflected, reflections + 1, found);
    } else if next > 0 {
        enumerate(interfaces, next - 1, false, reflected, reflections + 1, found);
    }
}
