"""compose.bucket.yaml and compose.garage.yaml on top of the cluster: files in a bucket, and no common folder."""

import secrets

from cluster import Cluster
from engine import hardened, healthy, run
from stacks import LARGE, SMALL, ended, send, with_profile


def check_stacks_survive_kills_of_the_bucket_and_of_a_worker():
    key, secret = "GK" + secrets.token_hex(12), secrets.token_hex(32)
    files = {
        "bucket": f"aws_access_key_id = {key}\naws_secret_access_key = {secret}\n",
        "garage.env": f"GARAGE_DEFAULT_BUCKET=stacks\nGARAGE_DEFAULT_ACCESS_KEY={key}\n"
        f"GARAGE_DEFAULT_SECRET_KEY={secret}\nGARAGE_RPC_SECRET={secrets.token_hex(32)}\n",
    }
    env = {"BUCKET": "s3://stacks/lab", "S3_ENDPOINT": "http://garage:3900"}
    with Cluster("compose.bucket.yaml", "compose.garage.yaml", secrets=files, env=env) as cluster:
        healthy(cluster.containers("garage")[0])
        for name in cluster.containers("worker"):
            hardened(name)
        service = cluster.service
        with_profile(service, LARGE)
        with_profile(service, SMALL)
        image = service.artifact(ended(service, send(service, SMALL)), "image")
        stacks = [send(service, LARGE, f"stack {index}") for index in range(2)]
        worker, bucket = cluster.running(stacks[0]), cluster.containers("garage")[0]
        run("docker", "kill", worker, bucket)
        run("docker", "start", worker, bucket)
        healthy(bucket)
        for stack in stacks:
            ended(service, stack)
        cluster("restart", "api")
        assert image in [service.artifact(stack, "image") for stack in service.list_stacks()]
