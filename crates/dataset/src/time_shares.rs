//! Divides the time of a run among its images: each gets an equal share of the time that is left.

/// Less time gives no useful image \[s\].
const LEAST: f64 = 0.02;

/// The time of a run, and the images that share it. Times are seconds since the start of the run.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct TimeShares {
    /// The end of the run.
    deadline: f64,
    /// Images that have not begun.
    waiting: u64,
    /// For each job, the time at which its image is expected to be finished; `None` between images.
    busy_until: Vec<Option<f64>>,
    /// Expected seconds of an image beyond its budget, before an image is finished.
    expected_excess: f64,
    /// Seconds of the finished images beyond their budgets, and the number of these images.
    excess: (f64, u64),
}

/// The time of one image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Share {
    /// The budget of the render \[s\].
    pub(crate) seconds: f64,
    /// The start of the image.
    began: f64,
}

impl TimeShares {
    /// `jobs` images are made at the same time. `expected_excess` is the time of an image outside of its budget, as far as
    /// it is known.
    pub(crate) fn new(deadline: f64, images: u64, jobs: usize, expected_excess: f64) -> Self {
        Self { deadline, waiting: images, busy_until: vec![None; jobs.max(1)], expected_excess, excess: (0.0, 0) }
    }

    /// The end of the run.
    pub(crate) fn deadline(&self) -> f64 {
        self.deadline
    }

    /// The expected budget of an image before the first one begins.
    pub(crate) fn expected(&self, now: f64) -> f64 {
        (self.share(now) - self.expected_excess).max(LEAST)
    }

    /// The expected end of the run before the first image begins: the deadline, or later if the images take longer with the
    /// least budget.
    pub(crate) fn expected_end(&self, now: f64) -> f64 {
        let rounds = self.waiting.div_ceil(self.busy_until.len() as u64) as f64;
        now + rounds * (self.expected(now) + self.expected_excess)
    }

    /// Begins an image on a job. Its budget is the share less the time that an image takes beyond its budget: changes of
    /// the scene, labels and files, and what the render does not use counts as negative.
    pub(crate) fn begin(&mut self, job: usize, now: f64) -> Share {
        if let Some(busy) = self.busy_until.get_mut(job) {
            *busy = None;
        }
        let share = self.share(now);
        self.waiting = self.waiting.saturating_sub(1);
        let (sum, count) = self.excess;
        let excess = if count > 0 { sum / count as f64 } else { self.expected_excess };
        let seconds = (share - excess).max(LEAST);
        if let Some(busy) = self.busy_until.get_mut(job) {
            *busy = Some(now + seconds + excess);
        }
        Share { seconds, began: now }
    }

    /// Ends an image that was made.
    pub(crate) fn finish(&mut self, job: usize, share: Share, now: f64) {
        self.excess = (self.excess.0 + (now - share.began - share.seconds), self.excess.1 + 1);
        self.release(job);
    }

    /// Ends an image that was not made.
    pub(crate) fn release(&mut self, job: usize) {
        if let Some(busy) = self.busy_until.get_mut(job) {
            *busy = None;
        }
    }

    /// The largest time that all waiting images can have until the deadline, each as a whole on one job. This is the method
    /// of D'Hondt: the jobs are parties, their times are the votes, and the images are the seats.
    fn share(&self, now: f64) -> f64 {
        /// Halvings of the interval: more than the bits of f64.
        const STEPS: u32 = 64;
        /// Rounding must not lose an image that fits exactly.
        const TOLERANCE: f64 = 1e-9;
        let left: Vec<f64> = (self.busy_until.iter())
            .map(|until| self.deadline - until.map_or(now, |until| until.max(now)))
            .filter(|left| *left > 0.0)
            .collect();
        let images = self.waiting.max(1) as f64;
        let fits = |share: f64| left.iter().map(|left| (left / share + TOLERANCE).floor()).sum::<f64>() >= images;
        let longest = left.iter().copied().fold(0.0, f64::max);
        if longest == 0.0 || fits(longest) {
            return longest;
        }
        // Each image would fit into the longest time if all were there.
        let (mut low, mut high) = (longest / images, longest);
        for _ in 0..STEPS {
            let middle = 0.5 * (low + high);
            if fits(middle) {
                low = middle;
            } else {
                high = middle;
            }
        }
        low
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Runs images on a clock of their own. An image with a budget of b takes `outside + used * b`. Gives the budgets in
    /// the order of the starts, and the end of the last image.
    fn simulate(deadline: f64, images: u64, jobs: usize, [guess, outside, used]: [f64; 3]) -> (Vec<f64>, f64) {
        let mut shares = TimeShares::new(deadline, images, jobs, guess);
        let mut running: Vec<Option<(Share, f64)>> = vec![None; jobs];
        let (mut budgets, mut now, mut begun) = (Vec::new(), 0.0, 0);
        loop {
            for (job, slot) in running.iter_mut().enumerate() {
                if slot.is_none() && begun < images {
                    let share = shares.begin(job, now);
                    budgets.push(share.seconds);
                    *slot = Some((share, now + outside + used * share.seconds));
                    begun += 1;
                }
            }
            let ends = running.iter().enumerate().filter_map(|(job, slot)| Some((job, (*slot)?)));
            let Some((job, (share, end))) = ends.min_by(|a, b| a.1.1.total_cmp(&b.1.1)) else { break };
            now = end;
            shares.finish(job, share, now);
            running[job] = None;
        }
        (budgets, now)
    }

    /// With images that take exactly their share, each job makes ceil(N / J) images at most, so that the share is
    /// T / ceil(N / J), and the last image ends at T.
    #[test]
    fn all_images_have_the_same_budget() {
        for (images, jobs) in [(1u64, 1), (12, 1), (12, 2), (13, 2), (16, 3), (100, 7), (5, 8)] {
            for outside in [0.0, 0.25, 1.0] {
                let rounds = images.div_ceil(jobs as u64) as f64;
                let deadline = 3.0 * rounds;
                let (budgets, end) = simulate(deadline, images, jobs, [outside, outside, 1.0]);
                assert_eq!(budgets.len() as u64, images);
                for budget in budgets {
                    assert!((budget - (3.0 - outside)).abs() < 1e-6, "{images} on {jobs}: {budget}, outside {outside}");
                }
                assert!((end - deadline).abs() < 1e-6, "{images} on {jobs}: {end}");
            }
        }
    }

    /// The render uses 80 % of its budget, and nothing is known of the time outside: only the first image of each job can
    /// differ. With a share s of the others, b = s - 0.5 + 0.2 b is the budget that takes s.
    #[test]
    fn a_wrong_expectation_is_corrected_after_the_first_images() {
        for jobs in [1, 2, 4] {
            let (budgets, end) = simulate(400.0, 200, jobs, [0.0, 0.5, 0.8]);
            let rest = &budgets[2 * jobs..];
            let (least, most) = rest.iter().fold((f64::INFINITY, 0.0f64), |(a, b), v| (a.min(*v), b.max(*v)));
            assert!(most / least < 1.05, "{jobs} jobs: {least} to {most}");
            let share = 400.0 * jobs as f64 / 200.0;
            assert!((rest[100] / ((share - 0.5) / 0.8) - 1.0).abs() < 0.02, "{jobs} jobs: {}", rest[100]);
            assert!((end - 400.0).abs() < 0.02 * 400.0, "{jobs} jobs end at {end}");
        }
    }

    /// 12 images on 2 jobs are 6 rounds: from 2 s to 20 s each image has 3 s, of which 0.5 s are outside of its render. With
    /// 0.6 s left no image has more than the least budget.
    #[test]
    fn the_expectation_is_that_of_the_first_image() {
        let shares = TimeShares::new(20.0, 12, 2, 0.5);
        assert!((shares.expected(2.0) - 2.5).abs() < 1e-9 && (shares.expected_end(2.0) - 20.0).abs() < 1e-6);
        assert_eq!(shares.clone().begin(0, 2.0).seconds, shares.expected(2.0));
        assert_eq!(shares.expected(19.4), LEAST);
        assert!((shares.expected_end(19.4) - (19.4 + 6.0 * (0.5 + LEAST))).abs() < 1e-9);
    }

    #[test]
    fn images_that_were_not_made_leave_their_time_to_the_others() {
        let mut shares = TimeShares::new(10.0, 10, 1, 0.0);
        assert!((shares.begin(0, 0.0).seconds - 1.0).abs() < 1e-9);
        shares.release(0);
        assert!((shares.begin(0, 0.0).seconds - 10.0 / 9.0).abs() < 1e-9);
        // After the end each image has the least time.
        shares.release(0);
        assert_eq!(shares.begin(0, 11.0).seconds, LEAST);
    }
}
