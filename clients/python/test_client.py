"""Uses the client as a stranger would: `python3 test_client.py http://127.0.0.1:8080`, against an empty service."""

import hashlib
import sys
import threading
import unittest
from typing import List

from afterimage_client import Client, FrameRequest, Problem, ReportRequest, RulesInput

URL = sys.argv.pop()


class ClientTest(unittest.TestCase):
    def setUp(self) -> None:
        self.client = Client(URL)

    def test_post_and_read(self) -> None:
        frames: List[FrameRequest] = [{"index": index, "metrics": {"psnr": 30.0 + index}} for index in range(3)]
        posted = self.client.create_report(
            {"sequence": "bistro", "system": "engine", "branch": "main", "commit": "from-python", "frames": frames}
        )
        report = self.client.get_report(posted["id"])
        self.assertEqual(report["values"]["psnr"], 31.0)
        self.assertEqual(len(self.client.list_frames(posted["id"])["frames"]), 3)
        self.assertIn(b"psnr", self.client.list_frames(posted["id"], format="csv"))
        series = self.client.list_series(metric="psnr", branch="main")["series"]
        self.assertEqual(series[0]["points"][0]["commit"], "from-python")
        page = self.client.list_points(series[0]["series_id"], metric="psnr", max_points=10)
        self.assertEqual(page["n_points"], 1)

    def test_problems(self) -> None:
        with self.assertRaises(Problem) as caught:
            self.client.get_report(10**9)
        self.assertEqual((caught.exception.status, caught.exception.code), (404, "not_found"))
        with self.assertRaises(Problem) as caught:
            self.client.create_report({"sequence": "a", "system": "b", "frames": [{"index": 0, "metrics": {"a b": 1}}]})
        self.assertEqual(caught.exception.field, "frames[0].metrics")

    def test_refused_before_it_is_read(self) -> None:
        with self.assertRaises(Problem) as caught:
            self.client.put_sequence("no name", bytes(16 << 20))
        self.assertEqual(caught.exception.status, 422)

    def test_race_with_one_key(self) -> None:
        body: ReportRequest = {"sequence": "race", "system": "engine", "values": {"psnr": 1.0}, "commit": "from-python"}
        ids: List[int] = []
        post = lambda: ids.append(self.client.create_report(body, idempotency_key="race-1")["id"])
        threads = [threading.Thread(target=post) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertEqual((len(ids), len(set(ids))), (4, 1))

    def test_blobs_and_pages(self) -> None:
        content = b"content"
        digest = hashlib.sha256(content).hexdigest()
        blob = self.client.put_blob(digest, content)
        assert blob is not None
        self.assertEqual(blob["n_bytes"], len(content))
        self.assertIsNone(self.client.head_blob(digest))
        large = bytes(range(256)) * 64
        digest = hashlib.sha256(large).hexdigest()
        self.client.put_blob(digest, large[:1000], content_range=f"bytes 0-999/{len(large)}")
        self.assertEqual(self.client.head_blob(digest), 1000)
        self.assertEqual(self.client.upload_blob(large), digest)
        self.assertEqual(self.client.upload_blob(large), digest)
        self.assertIsNone(self.client.head_blob(digest))
        for commit in range(5):
            self.client.create_report({"sequence": "pages", "system": "e", "values": {"psnr": 1}, "commit": "from-python"})
        walked = [report["id"] for report in self.client.iterate_reports(sequence="pages", limit=2)]
        self.assertEqual(len(walked), 5)
        self.assertEqual(walked, sorted(walked, reverse=True))

    def test_verdict(self) -> None:
        rules: RulesInput = {"rule": [{"metric": "psnr", "min": 30.0}]}
        report: ReportRequest = {
            "sequence": "v", "system": "e", "values": {"psnr": 20.0}, "commit": "from-python", "rules": rules
        }
        judgement = self.client.create_report(report)["judgement"]
        assert judgement is not None
        self.assertEqual(judgement["outcome"], "regression")
        self.assertEqual(self.client.list_recipes()["recipes"][0]["parameters"][0]["type"], "choice")


if __name__ == "__main__":
    unittest.main(argv=sys.argv)
