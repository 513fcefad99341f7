"""The store of campaigns: files are the truth about what has been computed.

STORE/CAMPAIGN_ID/campaign.toml   the spec
                  plan.json       the plan, immutable
                  manifest.json   what the parts were when last looked at; losing it costs time only
                  stopped.json    where the table ends, if the campaign stopped when it was sure
                  parts/part-000123.parquet          the rows of batch 123, whole or not there
                        rows-000000-000999.parquet   the rows of batches 0 to 999, merged of their parts
                  report/         what reporting wrote
"""

from campaign.store.parts import BadPart, Part, part_name
from campaign.store.store import Store, open_store
from campaign.store.survey import Survey

__all__ = ["BadPart", "Part", "Store", "Survey", "open_store", "part_name"]
