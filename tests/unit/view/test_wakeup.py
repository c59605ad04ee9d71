"""The event of viser's buffers: other threads may set it."""

import asyncio
import threading

from hil.view.scene.wakeup import ThreadSafeEvent


def test_only_the_event_loop_wakes_waiting_tasks() -> None:
    async def run() -> None:
        loop = asyncio.get_running_loop()
        event = ThreadSafeEvent(loop)
        waiting = [asyncio.ensure_future(event.wait()) for _ in range(3)]
        await asyncio.sleep(0)
        waiters = list(event._waiters)
        other = threading.Thread(target=event.set)
        other.start()
        other.join()
        assert event.is_set()
        assert not any(waiter.done() for waiter in waiters), "another thread iterated over the waiters"
        loop.call_soon_threadsafe(event.set)
        assert await asyncio.wait_for(asyncio.gather(*waiting), 10.0) == [True] * 3
        event.clear()
        assert not event.is_set()
        event.set()
        assert await event.wait()

    asyncio.run(run())
